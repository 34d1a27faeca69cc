"""Interfaces to autopilots and real cameras: MAVLink links, the safety envelope, camera sources, preflight checks."""
