"""Child processes: start, watch, and end them. None outlives its parent."""
