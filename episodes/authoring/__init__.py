"""Tools for people who make episodes: checks, proposals and pictures."""
