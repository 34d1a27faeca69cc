"""Pilots that are no models: vision, oracle, blind, recorded, failing; each behind the interface a model has."""
