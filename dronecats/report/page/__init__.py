"""The page: every flight of a benchmark in a browser, from the tables down to a step, without a network."""

from dronecats.report.page.writing import write_page

__all__ = ["write_page"]
