"""Records proposed by a seeded search: the map's places, starts around them, words for them, every check on top."""
