"""The HTML page of a report. It shows every flight of a benchmark, from the tables to a step, without a network."""
