"""Pilots that are no models: classical vision, oracle and blind, each behind the interface a model has."""
