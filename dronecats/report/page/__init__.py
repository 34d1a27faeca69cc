"""The page: every flight of a benchmark in a browser, from the tables down to a step, without a network."""
