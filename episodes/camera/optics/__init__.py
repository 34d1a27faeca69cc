"""What a real camera and real weather do to a frame. Everything is off unless asked for: the benchmark flies without.

`options` says what can be asked for and `file` reads it from TOML; `light` goes from sRGB codes to light and back,
`weather`, `rain` and `lens` are the effects, and `camera` applies them in the order in which light meets them.
"""
