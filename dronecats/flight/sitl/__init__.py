"""The simulator: vehicle, autopilot and camera on one clock, in real time or in lockstep."""
