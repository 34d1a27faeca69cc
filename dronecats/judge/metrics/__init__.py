"""Metrics of a flight beside its verdict: those of the paper, failure modes, audits."""
