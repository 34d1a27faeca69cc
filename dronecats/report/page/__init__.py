"""The report's page: every flight of a benchmark in a browser, from the tables to a step, without a network."""
