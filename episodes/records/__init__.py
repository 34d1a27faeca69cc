"""The episode records, their suites, and the baseline results of pilots on each episode."""
