"""The report's figures, each drawn from a table of it, so that no figure says what no table says."""
