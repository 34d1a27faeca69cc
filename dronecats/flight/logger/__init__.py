"""The logger of a flight, in real time a process. It writes truth, or the autopilot's estimate, and telemetry."""
