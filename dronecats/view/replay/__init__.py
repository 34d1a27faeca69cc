"""Flights in the browser again, from their folders alone: any moment of them, several of one episode at once."""
