"""Computes the light, depth and id of each pixel, and the picture with smooth edges.

Shading computes the light from a surface to the camera, at the middle of each pixel. Resolving smooths edges with the
samples in each pixel, and encodes the light as sRGB. If the middle of no nearby pixel shows the sample's surface,
resolving shades this sample, too.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.coverage import Drawn
from episodes.camera.renderer.environment import mirror_color
from episodes.camera.renderer.layout import Eye, Surfaces, Triangles
from episodes.camera.renderer.occlusion import Occlusion, open_sky
from episodes.camera.renderer.shadow import SunMap, sun_slopes, sunlight
from episodes.camera.renderer.sky import HAZE_LENGTH_M, STEPS, WHITE, Daylight, sky_color
from episodes.camera.renderer.textures import Atlas, drift, footprint, texture_color
from foundation.compiled import njit
from foundation.frames import Vec3

FRESH = 4  # px between updates of slowly changing values in `_shade`; a power of two
UNSEEN = -2  # index that stands for "no triangle yet"
# the sky's open share at a wall is read this far in front of the wall, in cells of the occlusion grid
AWAY_CELLS = 0.8
# upright things get darker from FOOT_M above the ground downwards; their foot loses FOOT_DARKNESS of the sky's light
FOOT_M, FOOT_DARKNESS = 0.8, 0.5
LEAF_BIAS_M = 0.35  # leaves do not shade one another within this distance towards the sun
LEAF_WRAP = 0.35  # wrap lighting: the sun lights leaves if (clump normal · sun direction) is above -LEAF_WRAP
SLIVER = 1e-7  # lower limit of (sum of weights) / volume: rounding must not put a thin triangle at infinity


class SceneLight(NamedTuple):
    """The light sources of a scene, and the tables for their shadows and reflections."""

    day: Daylight
    sun: SunMap
    shade: Occlusion
    sky: NDArray[np.float32]  # see `sky.sky_of`
    mirrored: NDArray[np.float32]  # see `environment.reflection_map`
    drift: NDArray[np.float32]  # see `textures.drift_table`


class ShadingInput(NamedTuple):
    """The input of shading: a picture with the triangle of each sample."""

    eye: Eye
    drawn: Drawn
    triangles: Triangles
    surfaces: Surfaces
    atlas: Atlas
    light: SceneLight
    samples: NDArray[np.int32]  # (eye.grain · H + 1, eye.grain · W + 1) the triangle that each sample sees


@njit(cache=True, nogil=True)
def measure_rows(
    thread: int, threads: int, shot: ShadingInput, depth: NDArray[np.float32], ids: NDArray[np.int32]
) -> None:
    """Fill this thread's rows of `depth` (H, W, m) and `ids` (H, W) from the samples at the middles of the pixels."""
    drawn, samples, instance = shot.drawn, shot.samples, shot.triangles.instance
    height, width = depth.shape
    grain, middle = shot.eye.grain, shot.eye.grain // 2
    for y in range(thread, height, threads):
        j = grain * y + middle
        for x in range(width):
            i = grain * x + middle
            t = samples[j, i]
            if t < 0:
                depth[y, x] = np.inf
                ids[y, x] = 0
            else:
                e, volume = drawn.edges[t], drawn.volume[t]
                weights = (e[0] + e[3] + e[6]) * i + (e[1] + e[4] + e[7]) * j + (e[2] + e[5] + e[8])
                depth[y, x] = volume / max(weights, SLIVER * volume)
                ids[y, x] = instance[t]


@njit(cache=True, nogil=True)
def shade_rows(
    thread: int, threads: int, shot: ShadingInput, light: NDArray[np.float32], places: NDArray[np.int32]
) -> None:
    """Fill this thread's rows of `light` (H, W, 3 linear, 0 … WHITE) from the middle sample of each pixel.

    `places` (threads, n ≥ W, 3) is a work array for each thread.
    """
    height, width = light.shape[:2]
    grain, middle = shot.eye.grain, shot.eye.grain // 2
    row = places[thread, :width]
    for y in range(thread, height, threads):
        for x in range(width):
            row[x, 0], row[x, 1] = grain * y + middle, grain * x + middle
        _shade(shot, row, light[y])


@njit(cache=True, nogil=True)
def _shade(shot: ShadingInput, places: NDArray[np.int32], light: NDArray[np.float32]) -> None:
    """Fill `light` (n, 3) with the light at the samples `places` (n, 3: row, column, not used here).

    Values of a triangle are computed again if a sample sees another triangle than the last sample, or is more than
    FRESH pixels to the side of it. The texture's footprint, the drift of the tone and the open share of the sky are
    also computed again every FRESH samples.
    """
    eye, drawn, triangles, surfaces, atlas, samples = (
        shot.eye, shot.drawn, shot.triangles, shot.surfaces, shot.atlas, shot.samples
    )  # fmt: skip
    day, sun, shade, sky, mirrored = (
        shot.light.day, shot.light.sun, shot.light.shade, shot.light.sky, shot.light.mirrored
    )  # fmt: skip
    aside = AWAY_CELLS / shade.per_cell
    per_px, per_sample = 1.0 / eye.focal, 1.0 / eye.grain
    # a texture is read once for every two samples in each direction
    reads = eye.grain // 2
    e, uv, normal, base = drawn.edges[0], triangles.uv[0], triangles.normal[0], surfaces.color[0]
    volume = emission = gloss = drifts = facing_sun = slope_x = slope_y = bias = 0.0
    fn = fe = fd = nn = ne = nd = 0.0
    texture, flat, leafy, last = -1, True, False, UNSEEN
    level, mix, doublings, step_u, step_v = np.int64(0), 0, 0, 0.0, 0.0
    ux = vx = uy = vy = 0.0
    tone, free, height = 0.0, 1.0, 0.0
    before, leap = 0.0, float(FRESH * eye.grain)
    for k in range(len(places)):
        j, i = float(places[k, 0]), float(places[k, 1])
        rx = (i * per_sample - eye.center_x) * per_px
        ry = (j * per_sample - eye.center_y) * per_px
        dn = eye.forward[0] + rx * eye.right[0] + ry * eye.down[0]
        de = eye.forward[1] + rx * eye.right[1] + ry * eye.down[1]
        dd = eye.forward[2] + rx * eye.right[2] + ry * eye.down[2]
        per = 1.0 / math.sqrt(1.0 + rx * rx + ry * ry)  # planar depth / distance
        t = samples[places[k, 0], places[k, 1]]
        if t < 0:
            r, g, b = sky_color(day, sky, dn * per, de * per, dd * per)
            light[k, 0], light[k, 1], light[k, 2] = min(r, WHITE), min(g, WHITE), min(b, WHITE)
            continue
        entered = t != last or abs(i - before) > leap
        before = i
        if entered:
            last = t
            e, uv, normal, volume = drawn.edges[t], triangles.uv[t], triangles.normal[t], drawn.volume[t]
            m = triangles.material[t]
            base, texture = surfaces.color[m], surfaces.texture[m]
            emission, gloss = float(surfaces.emission[m]), float(surfaces.specular[m])
            drifts = float(surfaces.drift[m])
            # turn both normals towards the viewer: the corners may have either order
            fn, fe, fd = float(triangles.face[t, 0]), float(triangles.face[t, 1]), float(triangles.face[t, 2])
            if fn * dn + fe * de + fd * dd > 0.0:
                fn, fe, fd = -fn, -fe, -fd
            leafy = surfaces.foliage[m]
            if leafy:  # light a leaf like its clump, not by the leaf's own direction
                fn, fe, fd = float(normal[0, 0]), float(normal[0, 1]), float(normal[0, 2])
                facing_sun, slope_x, slope_y, bias = 1.0, 0.0, 0.0, LEAF_BIAS_M
            else:
                facing_sun = day.toward[0] * fn + day.toward[1] * fe + day.toward[2] * fd
                slope_x, slope_y, bias = sun_slopes(sun, fn, fe, fd)
            flat = triangles.flat[t]
            if flat:
                nn, ne, nd = _toward(normal[0, 0], normal[0, 1], normal[0, 2], fn, fe, fd)
        w0 = e[0] * i + e[1] * j + e[2]
        w1 = e[3] * i + e[4] * j + e[5]
        w2 = e[6] * i + e[7] * j + e[8]
        share = 1.0 / max(w0 + w1 + w2, SLIVER * volume)
        z = volume * share
        w0 *= share
        w1 *= share
        w2 *= share

        r, g, b = float(base[0]), float(base[1]), float(base[2])
        if texture >= 0:
            u = w0 * uv[0, 0] + w1 * uv[1, 0] + w2 * uv[2, 0]
            v = w0 * uv[0, 1] + w1 * uv[1, 1] + w2 * uv[2, 1]
            if entered or k & (FRESH - 1) == 0:
                two = 2.0 * share  # for the change over two samples
                ux = two * (e[0] * (uv[0, 0] - u) + e[3] * (uv[1, 0] - u) + e[6] * (uv[2, 0] - u))
                vx = two * (e[0] * (uv[0, 1] - v) + e[3] * (uv[1, 1] - v) + e[6] * (uv[2, 1] - v))
                uy = two * (e[1] * (uv[0, 0] - u) + e[4] * (uv[1, 0] - u) + e[7] * (uv[2, 0] - u))
                vy = two * (e[1] * (uv[0, 1] - v) + e[4] * (uv[1, 1] - v) + e[7] * (uv[2, 1] - v))
                level, mix, doublings, step_u, step_v = footprint(atlas, texture, ux, vx, uy, vy)
            tr, tg, tb = texture_color(
                atlas, u, v, level, mix, doublings, step_u, step_v, ux, vx, uy, vy, reads
            )  # fmt: skip
            r *= tr
            g *= tg
            b *= tb

        if not flat:
            nn, ne, nd = _toward(
                w0 * normal[0, 0] + w1 * normal[1, 0] + w2 * normal[2, 0],
                w0 * normal[0, 1] + w1 * normal[1, 1] + w2 * normal[2, 1],
                w0 * normal[0, 2] + w1 * normal[1, 2] + w2 * normal[2, 2],
                fn,
                fe,
                fd,
            )
        pn, pe, pd = eye.position[0] + z * dn, eye.position[1] + z * de, eye.position[2] + z * dd
        if drifts > 0.0:
            if entered or k & (FRESH - 1) == 0:
                tone = drifts * drift(shot.light.drift, pn, pe, z)
            r *= 1.0 + 1.5 * tone
            g *= 1.0 + tone
            b *= 1.0 + 0.7 * tone
        direct = 0.0
        if facing_sun > 0.0:
            direct = day.toward[0] * nn + day.toward[1] * ne + day.toward[2] * nd
            direct = max((direct + LEAF_WRAP) * (1.0 / (1.0 + LEAF_WRAP)) if leafy else direct, 0.0)
            direct *= sunlight(sun, pn, pe, pd, slope_x, slope_y, bias)
        # read the open sky in front of a wall: sky that the wall itself hides must not darken the wall
        if entered or k & (FRESH - 1) == 0:
            free, height = open_sky(shade, pn + aside * fn, pe + aside * fe, pd + 0.2 * fd, fd)
        above = 0.5 - 0.5 * nd
        below = (1.0 - above) * min(0.25 + 1.5 * free, 1.0)
        above = min(above, free)
        if -0.3 < height < FOOT_M:  # upright things darken towards the foot, like the ground around them
            foot = 1.0 - FOOT_DARKNESS * (1.0 - nd * nd) * (1.0 - max(height, 0.0) * (1.0 / FOOT_M)) ** 2
            above *= foot
            below *= foot
        lr = r * (day.sun[0] * direct + day.ambient[0] * above + day.bounce[0] * below + emission)
        lg = g * (day.sun[1] * direct + day.ambient[1] * above + day.bounce[1] * below + emission)
        lb = b * (day.sun[2] * direct + day.ambient[2] * above + day.bounce[2] * below + emission)
        if gloss > 0.0:
            lr, lg, lb = _polish(
                day, mirrored, gloss, direct, free, dn * per, de * per, dd * per, nn, ne, nd, lr, lg, lb
            )

        air = z * (1.0 / HAZE_LENGTH_M)  # below: exp(-x) ≈ 1 / (1 + x + x² / 2) with x = air / per
        clear = per * per / (per * per + per * air + 0.5 * air * air)
        lr = day.horizon[0] + (lr - day.horizon[0]) * clear
        lg = day.horizon[1] + (lg - day.horizon[1]) * clear
        lb = day.horizon[2] + (lb - day.horizon[2]) * clear
        light[k, 0], light[k, 1], light[k, 2] = min(lr, WHITE), min(lg, WHITE), min(lb, WHITE)


@njit(cache=True, nogil=True)
def _toward(n: float, e: float, d: float, fn: float, fe: float, fd: float) -> Vec3:
    """Return the unit vector along (n, e, d), turned to the side of the unit vector f; f if (n, e, d) has no length."""
    square = n * n + e * e + d * d
    if square < 1e-12:
        return fn, fe, fd
    k = 1.0 / math.sqrt(square)
    if n * fn + e * fe + d * fd < 0.0:
        k = -k
    return n * k, e * k, d * k


@njit(cache=True, nogil=True)
def _polish(
    day: Daylight,
    mirrored: NDArray[np.float32],
    gloss: float,
    direct: float,
    free: float,
    dn: float,
    de: float,
    dd: float,
    nn: float,
    ne: float,
    nd: float,
    lr: float,
    lg: float,
    lb: float,
) -> Vec3:
    """Add a reflection of the surroundings and a soft highlight of the sun to the light (lr, lg, lb), and return it.

    The mirrored share follows Schlick's approximation of Fresnel's law. `free` is the open share of the sky.
    """
    facing = -(dn * nn + de * ne + dd * nd)
    grazing = 1.0 - min(max(facing, 0.0), 1.0)
    grazing2 = grazing * grazing
    straight = 0.04 + 0.10 * gloss
    share = gloss * (straight + (1.0 - straight) * grazing2 * grazing2 * grazing)
    rn, re, rd = dn + 2.0 * facing * nn, de + 2.0 * facing * ne, dd + 2.0 * facing * nd
    sr, sg, sb = mirror_color(mirrored, rn, re, rd)
    seen = min(0.3 + 1.5 * free, 1.0)
    lr += (sr * seen - lr) * share
    lg += (sg * seen - lg) * share
    lb += (sb * seen - lb) * share
    if direct > 0.0:
        shine = max(rn * day.toward[0] + re * day.toward[1] + rd * day.toward[2], 0.0)
        shine = shine * shine
        shine = shine * shine
        shine = shine * shine
        shine = shine * shine
        shine *= shine * gloss * (0.5 + 2.0 * share)
        lr += day.sun[0] * shine
        lg += day.sun[1] * shine
        lb += day.sun[2] * shine
    return lr, lg, lb


@njit(cache=True, nogil=True)
def resolve_rows(
    thread: int,
    threads: int,
    shot: ShadingInput,
    light: NDArray[np.float32],
    table: NDArray[np.uint8],
    rgb: NDArray[np.uint8],
    edges: NDArray[np.bool_],
    places: NDArray[np.int32],
    own: NDArray[np.float32],
    weights: NDArray[np.float32],
    means: NDArray[np.float32],
) -> None:
    """Write this thread's rows of `rgb` (H, W, 3) from `light` (H, W, 3 linear, 0 … WHITE) and `display_table`.

    A pixel whose samples all see one triangle keeps its light. Any other pixel gets the mean of its samples; samples on
    the border count half. If this pixel or a pixel next to the sample has the sample's flat piece (`Triangles.plane`)
    at its middle, the sample gets that pixel's light. Otherwise `_shade` shades the sample. Work arrays per thread:
    `edges` (threads, grain · W + 1), `places` and `own` (threads, n, 3), `weights` (threads, n), `means` (threads, W,
    3). n is the number of samples in a row of pixels; samples on a border count once per pixel.
    """
    height, width = rgb.shape[:2]
    samples, plane = shot.samples, shot.triangles.plane
    grain, middle = shot.eye.grain, shot.eye.grain // 2
    scale, half, per_weight = np.float32(STEPS / WHITE), np.float32(0.5), np.float32(0.25 / (grain * grain))
    edge, mean, pending, weight_of = edges[thread], means[thread], places[thread], weights[thread]
    for y in range(thread, height, threads):
        j, count = grain * y + middle, 0
        here = samples[j]
        _find_edges(samples[j - middle : j + middle + 1], middle, edge)
        for x in range(width):
            first = grain * x
            is_mixed = False
            for i in range(first, first + grain + 1):
                is_mixed |= edge[i]
            r, g, b = light[y, x, 0], light[y, x, 1], light[y, x, 2]
            if is_mixed:
                centre = here[first + middle]
                piece = plane[centre] if centre >= 0 else -1
                before, before_own, is_known = centre, UNSEEN, True
                cr, cg, cb = r, g, b
                r = g = b = np.float32(0.0)
                for dy in range(-middle, middle + 1):
                    for dx in range(-middle, middle + 1):
                        s = samples[j + dy, first + middle + dx]
                        weight = (1 if abs(dy) == middle else 2) * (1 if abs(dx) == middle else 2) * per_weight
                        if s != before:
                            before = s
                            wanted = plane[s] if s >= 0 else -1
                            qy, qx = y, x
                            if wanted != piece:
                                qy, qx = _find(shot, wanted, y, x, _sign(dy), _sign(dx), height, width)
                            is_known = qy >= 0
                            if is_known:
                                cr, cg, cb = light[qy, qx, 0], light[qy, qx, 1], light[qy, qx, 2]
                            elif s != before_own:
                                before_own = s
                                pending[count, 0], pending[count, 1], pending[count, 2] = j + dy, first + middle + dx, x
                                weight_of[count] = 0.0
                                count += 1
                        if is_known:
                            r += weight * cr
                            g += weight * cg
                            b += weight * cb
                        else:
                            weight_of[count - 1] += weight
            mean[x, 0], mean[x, 1], mean[x, 2] = r, g, b
        _shade(shot, pending[:count], own[thread, :count])
        for k in range(count):
            for c in range(3):
                mean[pending[k, 2], c] += weight_of[k] * own[thread, k, c]
        for x in range(width):
            for c in range(3):
                rgb[y, x, c] = table[int(min(mean[x, c], WHITE) * scale + half)]


@njit(cache=True, nogil=True)
def _find_edges(rows: NDArray[np.int32], middle: int, edge: NDArray[np.bool_]) -> None:
    """Set `edge` (n,) where a column of `rows` (k, n) is not uniform, or the next column differs in row `middle`."""
    here = rows[middle]
    last = len(here) - 1
    for i in range(last):
        edge[i] = here[i] != here[i + 1]
    edge[last] = False
    for k in range(len(rows)):
        row = rows[k]
        for i in range(last + 1):
            edge[i] |= row[i] != here[i]


@njit(cache=True, nogil=True)
def _sign(d: int) -> int:
    return (d > 0) - (d < 0)


@njit(cache=True, nogil=True)
def _find(
    shot: ShadingInput, wanted: int, y: int, x: int, dy: int, dx: int, height: int, width: int
) -> tuple[int, int]:
    """Return a pixel next to (y, x), on the side (dy, dx), with the piece `wanted` at its middle; (-1, -1): none."""
    samples, plane, grain = shot.samples, shot.triangles.plane, shot.eye.grain
    for choice in range(3):
        qy = y + (dy if choice != 1 else 0)
        qx = x + (dx if choice != 2 else 0)
        if 0 <= qy < height and 0 <= qx < width:
            s = samples[grain * qy + grain // 2, grain * qx + grain // 2]
            if (plane[s] if s >= 0 else -1) == wanted:
                return qy, qx
    return -1, -1
