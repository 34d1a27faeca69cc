"""Exports flights in the formats of other tools."""
