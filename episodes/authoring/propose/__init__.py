"""Proposes records with a seeded search, which draws targets, starts and instructions, and applies all checks."""
