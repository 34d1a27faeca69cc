"""The control cascade: position → velocity → attitude → rate. Compiled functions that read and write numpy records."""
