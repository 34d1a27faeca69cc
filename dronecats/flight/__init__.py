"""Flies one flight, from its specification to a judged run folder."""
