"""The cascade: position → velocity → attitude → rate. Pure compiled functions over three records."""
