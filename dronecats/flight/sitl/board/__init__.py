"""An autopilot board that flies the simulated vehicle over a wire."""
