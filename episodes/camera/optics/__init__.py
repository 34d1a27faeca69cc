"""The effects of a real camera and of weather on a frame. All are off by default, as in the benchmark.

`options` declares them and `file` reads them from TOML; `weather` has haze, sun and rain, and `camera` the lens, the
noise, and the order in which light passes all of them.
"""
