"""The flight modes: each turns what the vehicle knows and what was asked of it into one setpoint per tick."""
