"""Fits the networks and the error model of the vision pilot. No module that flies imports this package."""
