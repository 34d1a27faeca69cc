"""The report of a study: tables, figures, an HTML page that opens without a network, and data files."""
