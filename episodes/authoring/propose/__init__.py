"""Records proposed by a seeded search: places of the map, starts around them, words, and every check."""
