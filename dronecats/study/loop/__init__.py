"""Delay margins: of each control loop for its measurements, and of the cascade for the agent's setpoints."""
