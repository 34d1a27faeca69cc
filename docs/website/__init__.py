"""Builds the documentation as a site in build/site: `make docs`."""
