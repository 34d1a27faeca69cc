"""Verdicts, from the files of a run alone."""
