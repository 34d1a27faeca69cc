"""What an episode is flown on: vehicles, a camera, a clock and a logger; in one process, or in several."""
