"""An agent that bears a slow model: places instead of directions, and the next question while it flies."""
