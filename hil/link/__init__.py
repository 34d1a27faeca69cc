"""The link to any MAVLink autopilot: the wire, the conversation over it, and the flying through it."""
