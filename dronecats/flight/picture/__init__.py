"""Pictures of one flight, made from its files."""
