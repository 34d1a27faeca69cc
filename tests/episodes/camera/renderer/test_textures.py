"""A texel that counts for nothing need not be read: the colour is that of all reads that the footprint asks for."""

import numpy as np

from episodes.camera.renderer import textures
from episodes.camera.renderer.textures import LANE_1, LANE_2, LANE_MASK, WEIGHT, build_atlas, texture_color

ATLAS = build_atlas([np.random.default_rng(5).integers(0, 256, (48, 96, 3), dtype=np.uint8)])


def every_read(u, v, level, mix, doublings, step_u, step_v):
    """Return the colour with every read made, also those without weight."""

    def read(of, at_u, at_v, weight):
        first, w, h = ATLAS.levels[of]
        return int(textures._bilinear(ATLAS.texels, first, w, h, at_u, at_v, weight))

    upper = min(level + 1, len(ATLAS.levels) - 1)
    if doublings == 0:
        lanes = read(level, u, v, WEIGHT - mix) + read(upper, u, v, mix)
    else:
        pairs = 1 << (doublings - 1)
        part = mix >> (doublings - 1)
        rest = (WEIGHT >> (doublings - 1)) - part
        tu, tv, lanes = u - (pairs - 0.5) * step_u, v - (pairs - 0.5) * step_v, 0
        for _ in range(pairs):
            lanes += read(level, tu, tv, rest) + read(upper, tu + step_u, tv + step_v, part)
            tu, tv = tu + 2.0 * step_u, tv + 2.0 * step_v
    k = 1.0 / (1023.0 * WEIGHT)
    mask = int(LANE_MASK)
    return tuple(
        (k * code) * (k * code) for code in (lanes >> int(LANE_2), (lanes >> int(LANE_1)) & mask, lanes & mask)
    )


def test_a_colour_is_that_of_every_read():
    for mix in (0, 1, 3, 700, WEIGHT - 1):
        for doublings in (0, 1, 2, 3):
            draw = np.random.default_rng((doublings, mix))
            for level in (0, 2, len(ATLAS.levels) - 2):
                for _ in range(50):
                    u, v = draw.uniform(-3.0, 3.0, 2)
                    step_u, step_v = draw.uniform(-0.2, 0.2, 2)
                    found = texture_color(ATLAS, u, v, np.int64(level), mix, doublings, step_u, step_v)
                    assert found == every_read(u, v, level, mix, doublings, step_u, step_v), (doublings, mix)
