"""Measures two tolerances: of a control loop to feedback delay, and of a flight to jitter and loss of setpoints."""
