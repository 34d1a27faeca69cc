"""The tables of the report, each a pure function of its data."""
