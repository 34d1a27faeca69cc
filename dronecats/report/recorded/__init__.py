"""Reads flights and runs from their folders."""
