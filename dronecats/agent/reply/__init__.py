"""Parses a model's reply into one action per drone, or the reason why there is none. docs/replies.md."""
