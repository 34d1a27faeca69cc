"""A real PX4 that flies the simulated vehicle over its simulator interface."""
