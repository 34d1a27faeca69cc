"""Flights in other people's formats: each reads an episode once, and writes what that format's own tools open."""
