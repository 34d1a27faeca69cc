"""Runs episodes: starts all parts of a flight, flies to the start pose, lets the agent fly, lands, and closes all."""
