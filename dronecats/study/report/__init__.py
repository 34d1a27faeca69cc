"""The report of a study: tables, figures, one page that opens without a network, and the data beside them."""
