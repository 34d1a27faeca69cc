"""Measures how much delay each control loop tolerates in its feedback, and the cascade in the agent's setpoints."""
