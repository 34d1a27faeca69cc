"""The logger of a flight, a process in real time. It writes telemetry, and true poses or the autopilot's estimate."""
