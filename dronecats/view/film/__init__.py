"""Films of flights, made from a run folder: camera paths, the composition of a picture, and encoding."""
