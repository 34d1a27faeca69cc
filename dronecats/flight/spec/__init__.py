"""A flight as a value: all that is asked for, as it stands in run.json, and what it comes to when it is looked up."""
