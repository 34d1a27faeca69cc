"""Computes a study's results from its flights. Only `joined` reads files."""
