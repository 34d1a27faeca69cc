"""Studies: flights that measure the effect of latency, jitter, the link or the wind, and their statistics."""
