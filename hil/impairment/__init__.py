"""Bad wires: loss, delay, reordering and damage, seeded."""
