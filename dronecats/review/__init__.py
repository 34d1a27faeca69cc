"""The report of a benchmark: the paper's tables and figures from one's own runs, and a page to look through them."""
