"""The flight modes. Each mode computes one setpoint per tick from the estimate, the parameters and the requests."""
