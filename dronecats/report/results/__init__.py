"""The results of runs: one row per episode, entrants that may be compared, and SQL tables."""
