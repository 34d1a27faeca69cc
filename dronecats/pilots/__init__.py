"""Pilots that are no models: vision, oracle, noisy, blind, recorded, failing; each behind the interface a model has."""
