"""What is said of a flown episode beside its verdict: every metric of the paper, failure modes, audits."""
