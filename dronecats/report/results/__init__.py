"""Runs read back: which belong together, what each of their episodes came to, tables for whoever asks in SQL."""
