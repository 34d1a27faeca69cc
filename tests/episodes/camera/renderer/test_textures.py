"""`texture_color` skips texels without weight. Its colour equals that of a computation which reads every texel."""

import numpy as np

from episodes.camera.renderer import textures
from episodes.camera.renderer.textures import LANE_1, LANE_2, LANE_MASK, WEIGHT, build_atlas, texture_color

ATLAS = build_atlas([np.random.default_rng(5).integers(0, 256, (48, 96, 3), dtype=np.uint8)])


def every_read(places, level, mix, doublings, step_u, step_v):
    """Return the mean colour at `places` (u, v) from all reads, including those without weight."""

    def read(of, at_u, at_v, weight):
        first, w, h = ATLAS.levels[of]
        return int(textures._bilinear(ATLAS.texels, first, w, h, at_u, at_v, weight))

    upper, lanes = min(level + 1, len(ATLAS.levels) - 1), 0
    pairs = 1 << max(doublings - 1, 0)
    part = mix // (pairs * len(places))
    rest = WEIGHT // (pairs * len(places)) - part
    for u, v in places:
        if doublings == 0:
            lanes += read(level, u, v, rest) + read(upper, u, v, part)
            continue
        tu, tv = u - (pairs - 0.5) * step_u, v - (pairs - 0.5) * step_v
        for _ in range(pairs):
            lanes += read(level, tu, tv, rest) + read(upper, tu + step_u, tv + step_v, part)
            tu, tv = tu + 2.0 * step_u, tv + 2.0 * step_v
    k = 1.0 / (1023.0 * WEIGHT)
    mask = int(LANE_MASK)
    return tuple(
        (k * code) * (k * code) for code in (lanes >> int(LANE_2), (lanes >> int(LANE_1)) & mask, lanes & mask)
    )


def test_texture_color_equals_the_colour_of_all_reads():
    for mix in (0, 1, 3, 700, WEIGHT - 1):
        for doublings in (0, 1, 2, 3):
            draw = np.random.default_rng((doublings, mix))
            for level in (0, 2, len(ATLAS.levels) - 2):
                for _ in range(50):
                    u, v = draw.uniform(-3.0, 3.0, 2)
                    (step_u, step_v), right, down = draw.uniform(-0.2, 0.2, (3, 2))
                    how = np.int64(level), mix, doublings, step_u, step_v
                    one = texture_color(ATLAS, u, v, *how, right[0], right[1], down[0], down[1], 1)
                    assert one == every_read([(u, v)], *how), (doublings, mix)
                    four = [
                        (u + 0.5 * (i * right[0] + j * down[0]), v + 0.5 * (i * right[1] + j * down[1]))
                        for i, j in ((-1, -1), (1, -1), (-1, 1), (1, 1))
                    ]
                    color = texture_color(ATLAS, u, v, *how, right[0], right[1], down[0], down[1], 2)
                    np.testing.assert_allclose(color, every_read(four, *how), rtol=0.02, atol=0.002)
