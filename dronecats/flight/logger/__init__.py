"""The logger: a separate process that writes the truth of a flight."""
