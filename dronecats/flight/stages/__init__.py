"""Stages. A stage has the vehicles, camera, clock and logger of an episode, in one process or in several."""
