"""Derives verdicts from the files of a run alone."""
