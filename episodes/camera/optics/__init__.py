"""The effects of a real camera and of weather on a frame. All are off by default, as in the benchmark.

`options` declares the options, and `file` reads them from TOML. `weather` computes haze and rain. `camera` computes
exposure, lens and noise, and applies all effects in order.
"""
