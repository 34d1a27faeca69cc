"""The constants of the paper's protocol."""

CAP_S = 300.0  # s of vehicle time, the length of an episode
