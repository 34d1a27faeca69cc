"""Starts, watches and ends child processes. No child outlives its parent."""
