"""Checks of a vehicle before it flies by offboard setpoints. Nothing here arms a vehicle."""
