"""Wires to things we did not write: links to any MAVLink autopilot, real cameras, the safety envelope."""
