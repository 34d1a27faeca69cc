"""Intervals and tests for scores of few episodes. Pure; knows nothing of drones."""
