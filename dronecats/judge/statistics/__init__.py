"""Computes intervals and tests for scores of few episodes. Pure functions, which do not depend on drones."""
