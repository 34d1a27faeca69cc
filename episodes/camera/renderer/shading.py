"""The light of each pixel with its depth and id, and the picture with smooth edges.

Shading computes the light that leaves the surface towards the camera. Resolving smooths edges by the samples around
each pixel and encodes the light as sRGB.
"""

import math

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.coverage import Drawn
from episodes.camera.renderer.layout import Eye, Surfaces, Triangles
from episodes.camera.renderer.shadow import SunMap, sun_slopes, sunlight
from episodes.camera.renderer.sky import HAZE_LENGTH_M, STEPS, WHITE, Daylight, sky_color
from episodes.camera.renderer.textures import Atlas, footprint, texture_color
from foundation.compiled import njit
from foundation.frames import Vec3

FRESH = 4  # px, a power of two


@njit(cache=True, nogil=True)
def shade_rows(
    thread: int,
    threads: int,
    eye: Eye,
    drawn: Drawn,
    triangles: Triangles,
    surfaces: Surfaces,
    atlas: Atlas,
    sun: SunMap,
    day: Daylight,
    per_metre: NDArray[np.float32],
    samples: NDArray[np.int32],
    light: NDArray[np.float32],
    depth: NDArray[np.float32],
    ids: NDArray[np.int32],
) -> None:
    """Fill this thread's rows of `light` (H, W, 3 linear, 0 … WHITE), `depth` (H, W, m) and `ids` (H, W).

    Only the sample at the middle of each pixel counts. Values of a triangle are computed when the row enters it, and
    the footprint of its texture every FRESH pixels. `depth` and `ids` without rows are left out.
    """
    height, width = light.shape[:2]
    measured = len(depth) > 0
    per_px = 1.0 / eye.focal
    e, uv, base = drawn.edges[0], triangles.uv[0], surfaces.color[0]  # of the triangle of the last pixel
    volume = emission = gloss = facing_sun = slope_x = slope_y = bias = 0.0
    fn = fe = fd = nn = ne = nd = 0.0
    mix = doublings = m = 0
    level = np.int64(0)
    step_u = step_v = 0.0
    texture, flat = -1, True
    for y in range(thread, height, threads):
        j = 2.0 * y + 1.0
        ry = (y + 0.5 - eye.center_y) * per_px
        last = -2
        seen, shown = samples[2 * y + 1], light[y]
        cosine = per_metre[y]
        for x in range(width):
            i = 2.0 * x + 1.0
            rx = (x + 0.5 - eye.center_x) * per_px
            dn = eye.forward[0] + rx * eye.right[0] + ry * eye.down[0]
            de = eye.forward[1] + rx * eye.right[1] + ry * eye.down[1]
            dd = eye.forward[2] + rx * eye.right[2] + ry * eye.down[2]
            per = float(cosine[x])  # of the ray's length to its depth
            t = seen[2 * x + 1]
            if t < 0:
                r, g, b = sky_color(day, dn * per, de * per, dd * per)
                shown[x, 0], shown[x, 1], shown[x, 2] = min(r, WHITE), min(g, WHITE), min(b, WHITE)
                if measured:
                    depth[y, x] = np.inf
                    ids[y, x] = 0
                continue

            entered = t != last
            if entered:
                last = t
                e = drawn.edges[t]
                volume = drawn.volume[t]
                m = triangles.material[t]
                base = surfaces.color[m]
                uv = triangles.uv[t]
                texture = surfaces.texture[m]
                emission = float(surfaces.emission[m])
                gloss = float(surfaces.specular[m])
                # both normals on the side of the viewer, whatever the order of the corners
                fn, fe, fd = float(triangles.face[t, 0]), float(triangles.face[t, 1]), float(triangles.face[t, 2])
                if fn * dn + fe * de + fd * dd > 0.0:
                    fn, fe, fd = -fn, -fe, -fd
                facing_sun = day.toward[0] * fn + day.toward[1] * fe + day.toward[2] * fd
                slope_x, slope_y, bias = sun_slopes(sun, fn, fe, fd)
                flat = triangles.flat[t]
                if flat:
                    nn, ne, nd = _toward(
                        triangles.normal[t, 0, 0], triangles.normal[t, 0, 1], triangles.normal[t, 0, 2], fn, fe, fd
                    )
            w0 = e[0] * i + e[1] * j + e[2]
            w1 = e[3] * i + e[4] * j + e[5]
            w2 = e[6] * i + e[7] * j + e[8]
            share = 1.0 / max(w0 + w1 + w2, 1e-7 * volume)  # rounding must not put a sliver at infinity
            z = volume * share
            if measured:
                depth[y, x] = z
                ids[y, x] = triangles.instance[t]
            w0 *= share
            w1 *= share
            w2 *= share

            r, g, b = float(base[0]), float(base[1]), float(base[2])
            if texture >= 0:
                u = w0 * uv[0, 0] + w1 * uv[1, 0] + w2 * uv[2, 0]
                v = w0 * uv[0, 1] + w1 * uv[1, 1] + w2 * uv[2, 1]
                if entered or x & (FRESH - 1) == 0:
                    k = 2.0 * share  # two samples per pixel
                    ux = k * (e[0] * (uv[0, 0] - u) + e[3] * (uv[1, 0] - u) + e[6] * (uv[2, 0] - u))
                    vx = k * (e[0] * (uv[0, 1] - v) + e[3] * (uv[1, 1] - v) + e[6] * (uv[2, 1] - v))
                    uy = k * (e[1] * (uv[0, 0] - u) + e[4] * (uv[1, 0] - u) + e[7] * (uv[2, 0] - u))
                    vy = k * (e[1] * (uv[0, 1] - v) + e[4] * (uv[1, 1] - v) + e[7] * (uv[2, 1] - v))
                    level, mix, doublings, step_u, step_v = footprint(atlas, texture, ux, vx, uy, vy)
                tr, tg, tb = texture_color(atlas, u, v, level, mix, doublings, step_u, step_v)
                r *= tr
                g *= tg
                b *= tb

            if not flat:
                nn, ne, nd = _toward(
                    w0 * triangles.normal[t, 0, 0] + w1 * triangles.normal[t, 1, 0] + w2 * triangles.normal[t, 2, 0],
                    w0 * triangles.normal[t, 0, 1] + w1 * triangles.normal[t, 1, 1] + w2 * triangles.normal[t, 2, 1],
                    w0 * triangles.normal[t, 0, 2] + w1 * triangles.normal[t, 1, 2] + w2 * triangles.normal[t, 2, 2],
                    fn,
                    fe,
                    fd,
                )
            direct = 0.0
            if facing_sun > 0.0:
                direct = max(day.toward[0] * nn + day.toward[1] * ne + day.toward[2] * nd, 0.0)
                pn, pe, pd = eye.position[0] + z * dn, eye.position[1] + z * de, eye.position[2] + z * dd
                direct *= sunlight(sun, pn, pe, pd, slope_x, slope_y, bias)
            above = 0.5 - 0.5 * nd
            below = 1.0 - above
            lr = r * (day.sun[0] * direct + day.ambient[0] * above + day.bounce[0] * below + emission)
            lg = g * (day.sun[1] * direct + day.ambient[1] * above + day.bounce[1] * below + emission)
            lb = b * (day.sun[2] * direct + day.ambient[2] * above + day.bounce[2] * below + emission)
            if gloss > 0.0:
                lr, lg, lb = _polish(day, gloss, direct, dn * per, de * per, dd * per, nn, ne, nd, lr, lg, lb)

            air = z * (1.0 / HAZE_LENGTH_M)  # and below with air / per, to the second order: exp(-air / per)
            clear = per * per / (per * per + per * air + 0.5 * air * air)
            lr = day.horizon[0] + (lr - day.horizon[0]) * clear
            lg = day.horizon[1] + (lg - day.horizon[1]) * clear
            lb = day.horizon[2] + (lb - day.horizon[2]) * clear
            shown[x, 0], shown[x, 1], shown[x, 2] = min(lr, WHITE), min(lg, WHITE), min(lb, WHITE)


@njit(cache=True, nogil=True)
def _toward(n: float, e: float, d: float, fn: float, fe: float, fd: float) -> Vec3:
    """Return the vector (n, e, d) at unit length and on the side of the unit vector f; f itself if it has no length."""
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
    gloss: float,
    direct: float,
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
    """Return the light (lr, lg, lb) of a surface with the mirrored sky and a soft highlight of the sun added.

    The mirrored share follows Schlick's approximation of Fresnel's law with 0.04 at normal incidence.
    """
    facing = -(dn * nn + de * ne + dd * nd)
    grazing = 1.0 - min(max(facing, 0.0), 1.0)
    grazing2 = grazing * grazing
    mirrored = gloss * (0.04 + 0.96 * grazing2 * grazing2 * grazing)
    rn, re, rd = dn + 2.0 * facing * nn, de + 2.0 * facing * ne, dd + 2.0 * facing * nd
    above = min(max(0.5 - 2.5 * rd, 0.0), 1.0)  # the mirrored horizon is soft; below it lies the ground
    low = (1.0 - max(-rd, 0.0)) ** 3
    sr = day.zenith[0] + (day.horizon[0] - day.zenith[0]) * low
    sg = day.zenith[1] + (day.horizon[1] - day.zenith[1]) * low
    sb = day.zenith[2] + (day.horizon[2] - day.zenith[2]) * low
    sr = day.bounce[0] + (sr - day.bounce[0]) * above
    sg = day.bounce[1] + (sg - day.bounce[1]) * above
    sb = day.bounce[2] + (sb - day.bounce[2]) * above
    lr += (sr - lr) * mirrored
    lg += (sg - lg) * mirrored
    lb += (sb - lb) * mirrored
    if direct > 0.0:
        shine = max(rn * day.toward[0] + re * day.toward[1] + rd * day.toward[2], 0.0)
        shine = shine * shine
        shine = shine * shine
        shine = shine * shine
        shine = shine * shine
        shine *= shine * gloss * (0.5 + 2.0 * mirrored)
        lr += day.sun[0] * shine
        lg += day.sun[1] * shine
        lb += day.sun[2] * shine
    return lr, lg, lb


@njit(cache=True, nogil=True)
def resolve_rows(
    thread: int,
    threads: int,
    samples: NDArray[np.int32],
    plane: NDArray[np.int32],
    light: NDArray[np.float32],
    table: NDArray[np.uint8],
    rgb: NDArray[np.uint8],
) -> None:
    """Write this thread's rows of `rgb` (H, W, 3) from `light` (H, W, 3 linear, 0 … WHITE) and `display_table`.

    A pixel whose nine samples see one flat piece keeps its colour. Elsewhere each sample counts with the weight of a
    tent one pixel wide on either side, and brings the colour of the pixel beside it that sees the same piece; a piece
    that no neighbouring middle sees is left out.
    """
    height, width = rgb.shape[:2]
    scale, half = np.float32(STEPS / WHITE), np.float32(0.5)
    for y in range(thread, height, threads):
        j = 2 * y + 1
        above, here, below = samples[j - 1], samples[j], samples[j + 1]
        shaded, shown = light[y], rgb[y]
        for x in range(width):
            i = 2 * x + 1
            t = here[i]
            same = (
                above[i - 1] == t
                and above[i] == t
                and above[i + 1] == t
                and here[i - 1] == t
                and here[i + 1] == t
                and below[i - 1] == t
                and below[i] == t
                and below[i + 1] == t
            )
            r = shaded[x, 0]
            g = shaded[x, 1]
            b = shaded[x, 2]
            if not same:
                piece = plane[t] if t >= 0 else -1
                total = np.float32(4.0)
                r *= total
                g *= total
                b *= total
                for dy in range(-1, 2):
                    for dx in range(-1, 2):
                        if dx == 0 and dy == 0:
                            continue
                        s = samples[j + dy, i + dx]
                        wanted = plane[s] if s >= 0 else -1
                        qy, qx = y, x
                        if wanted != piece:
                            qy, qx = _find(samples, plane, wanted, y, x, dy, dx, height, width)
                            if qy < 0:
                                continue
                        w = np.float32((2 - abs(dx)) * (2 - abs(dy)))
                        r += w * light[qy, qx, 0]
                        g += w * light[qy, qx, 1]
                        b += w * light[qy, qx, 2]
                        total += w
                r /= total
                g /= total
                b /= total
            shown[x, 0] = table[int(r * scale + half)]
            shown[x, 1] = table[int(g * scale + half)]
            shown[x, 2] = table[int(b * scale + half)]


@njit(cache=True, nogil=True)
def _find(
    samples: NDArray[np.int32],
    plane: NDArray[np.int32],
    wanted: int,
    y: int,
    x: int,
    dy: int,
    dx: int,
    height: int,
    width: int,
) -> tuple[int, int]:
    """Return the pixel beside the sample (dy, dx) of pixel (y, x) whose middle sees the piece `wanted`, or (-1, -1)."""
    for choice in range(3):
        qy = y + (dy if choice != 1 else 0)
        qx = x + (dx if choice != 2 else 0)
        if 0 <= qy < height and 0 <= qx < width:
            s = samples[2 * qy + 1, 2 * qx + 1]
            if (plane[s] if s >= 0 else -1) == wanted:
                return qy, qx
    return -1, -1
