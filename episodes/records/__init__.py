"""The episode records, the suites that name them, and what is kept for each."""
