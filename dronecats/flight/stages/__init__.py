"""Stages, on which episodes are flown: vehicles, a camera, a clock and a logger; in one process, or in several."""
