"""The study's figures, as one would put them into a paper: each says which command makes it."""
