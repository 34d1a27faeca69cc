"""A map and what stands on it as a browser shows it: of the editor, and of the pages of flights."""
