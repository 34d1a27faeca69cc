"""What the vision pilot sees of a residential target: pictures with the truth, and counts."""
