"""An agent for slow models. It flies to places instead of in directions, and asks the next question in flight."""
