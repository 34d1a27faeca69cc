"""Many episodes: who flies which, what was flown already, and what came of it."""
