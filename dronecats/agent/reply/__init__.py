"""Parses a model's reply into one action per drone, or the reason why there is none. See docs/replies.md."""
