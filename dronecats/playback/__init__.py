"""A flight that was flown, in the browser again."""
