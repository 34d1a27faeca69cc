"""The settings of a flight, as in run.json, and the checked flight that they describe."""
