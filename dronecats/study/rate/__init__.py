"""Measures each delay in a user's timing chain, from camera to setpoint, so that flights can simulate the delays."""
