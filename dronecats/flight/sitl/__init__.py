"""Our simulator as a whole: vehicle, autopilot and camera on one clock, in real time or in lockstep."""
