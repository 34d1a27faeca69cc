"""The report's tables, a file a question, each a pure function of who flew."""
