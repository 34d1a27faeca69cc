"""Measures the delay of each link of a user's chain, from the camera to the setpoint, so that it can be simulated."""
