"""Pilots that look at no picture: blind patterns, recorded replies, and a scripted commander."""
