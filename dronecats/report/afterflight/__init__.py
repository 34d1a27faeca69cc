"""After a flight whose truth nobody measured: its path from what the estimator said, and the flight judged by it."""
