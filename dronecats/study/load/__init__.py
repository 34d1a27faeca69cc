"""What a busy host does to flights in lockstep and in real time, and whether the ones it moves are marked."""
