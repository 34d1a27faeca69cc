"""A commander over the pilots of a fleet: its prompt, its orders, and the agent that they make together."""
