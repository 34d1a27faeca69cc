"""A flight as a value: its settings, as in run.json, and the flight that they describe."""
