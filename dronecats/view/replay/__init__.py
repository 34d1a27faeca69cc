"""Replays in the browser, from run folders: any moment of a flight, and several flights of one episode at once."""
