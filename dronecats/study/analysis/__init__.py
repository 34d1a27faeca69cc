"""Computes a study's results from its flights. Only `loading` reads files."""
