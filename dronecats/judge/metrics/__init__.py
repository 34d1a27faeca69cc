"""Computes metrics of a flight besides its verdict: the paper's metrics, failure modes and audits."""
