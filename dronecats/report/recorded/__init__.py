"""Flights read back from their folders, with everything that logs, MAVLink and the world tell of them."""
