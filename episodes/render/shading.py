"""The light that leaves each pixel's surface towards the camera, its depth and its id."""

import math

import numba
import numpy as np

from episodes.render.shadow import sunlight
from episodes.render.sky import HAZE_LENGTH_M, displayed, sky_color
from episodes.render.textures import texture_color


@numba.njit(cache=True, nogil=True)
def shade_rows(thread, threads, eye, drawn, triangles, surfaces, atlas, sun, day, samples, color, depth, ids):
    """Fill this thread's rows of `color` (H, W, 3 linear, displayable), `depth` (H, W, m) and `ids` (H, W).

    Only the sample at the middle of each pixel is looked at.
    """
    height, width = depth.shape
    e = np.zeros(9)
    per_px = 1.0 / eye.focal
    for y in range(thread, height, threads):
        j = 2.0 * y + 1.0
        ry = (y + 0.5 - eye.center_y) * per_px
        last = -2
        volume = 0.0
        for x in range(width):
            i = 2.0 * x + 1.0
            rx = (x + 0.5 - eye.center_x) * per_px
            dn = eye.forward[0] + rx * eye.right[0] + ry * eye.down[0]
            de = eye.forward[1] + rx * eye.right[1] + ry * eye.down[1]
            dd = eye.forward[2] + rx * eye.right[2] + ry * eye.down[2]
            length = math.sqrt(1.0 + rx * rx + ry * ry)
            t = samples[2 * y + 1, 2 * x + 1]
            if t < 0:
                per = 1.0 / length
                r, g, b = sky_color(day, dn * per, de * per, dd * per)
                color[y, x, 0], color[y, x, 1], color[y, x, 2] = displayed(r, g, b)
                depth[y, x] = np.inf
                ids[y, x] = 0
                continue
            if t != last:
                last = t
                for k in range(9):
                    e[k] = drawn.edges[t, k]
                volume = drawn.volume[t]
            w0 = e[0] * i + e[1] * j + e[2]
            w1 = e[3] * i + e[4] * j + e[5]
            w2 = e[6] * i + e[7] * j + e[8]
            share = 1.0 / (w0 + w1 + w2)
            z = volume * share
            depth[y, x] = z
            ids[y, x] = triangles.instance[t]
            w0 *= share
            w1 *= share
            w2 *= share

            m = triangles.material[t]
            r = float(surfaces.color[m, 0])
            g = float(surfaces.color[m, 1])
            b = float(surfaces.color[m, 2])
            texture = surfaces.texture[m]
            if texture >= 0:
                u0, v0 = float(triangles.uv[t, 0, 0]), float(triangles.uv[t, 0, 1])
                u1, v1 = float(triangles.uv[t, 1, 0]), float(triangles.uv[t, 1, 1])
                u2, v2 = float(triangles.uv[t, 2, 0]), float(triangles.uv[t, 2, 1])
                u = w0 * u0 + w1 * u1 + w2 * u2
                v = w0 * v0 + w1 * v1 + w2 * v2
                k = 2.0 * share  # two samples per pixel
                ux = k * (e[0] * (u0 - u) + e[3] * (u1 - u) + e[6] * (u2 - u))
                vx = k * (e[0] * (v0 - v) + e[3] * (v1 - v) + e[6] * (v2 - v))
                uy = k * (e[1] * (u0 - u) + e[4] * (u1 - u) + e[7] * (u2 - u))
                vy = k * (e[1] * (v0 - v) + e[4] * (v1 - v) + e[7] * (v2 - v))
                tr, tg, tb = texture_color(atlas, texture, u, v, ux, vx, uy, vy)
                r *= tr
                g *= tg
                b *= tb

            # both normals on the side of the viewer, whatever the order of the corners
            fn, fe, fd = float(triangles.face[t, 0]), float(triangles.face[t, 1]), float(triangles.face[t, 2])
            if fn * dn + fe * de + fd * dd > 0.0:
                fn, fe, fd = -fn, -fe, -fd
            nn = w0 * triangles.normal[t, 0, 0] + w1 * triangles.normal[t, 1, 0] + w2 * triangles.normal[t, 2, 0]
            ne = w0 * triangles.normal[t, 0, 1] + w1 * triangles.normal[t, 1, 1] + w2 * triangles.normal[t, 2, 1]
            nd = w0 * triangles.normal[t, 0, 2] + w1 * triangles.normal[t, 1, 2] + w2 * triangles.normal[t, 2, 2]
            k = math.sqrt(nn * nn + ne * ne + nd * nd)
            if k > 1e-6:
                k = 1.0 / k
                if nn * fn + ne * fe + nd * fd < 0.0:
                    k = -k
                nn, ne, nd = nn * k, ne * k, nd * k
            else:
                nn, ne, nd = fn, fe, fd

            direct = day.toward[0] * nn + day.toward[1] * ne + day.toward[2] * nd
            if direct > 0.0:
                direct *= sunlight(
                    sun,
                    eye.position[0] + z * dn,
                    eye.position[1] + z * de,
                    eye.position[2] + z * dd,
                    fn,
                    fe,
                    fd,
                )
            else:
                direct = 0.0
            above = 0.5 - 0.5 * nd
            emission = float(surfaces.emission[m])
            lr = r * (day.sun[0] * direct + day.ambient[0] * above + day.bounce[0] * (1.0 - above) + emission)
            lg = g * (day.sun[1] * direct + day.ambient[1] * above + day.bounce[1] * (1.0 - above) + emission)
            lb = b * (day.sun[2] * direct + day.ambient[2] * above + day.bounce[2] * (1.0 - above) + emission)

            gloss = float(surfaces.specular[m])
            if gloss > 0.0:
                per = 1.0 / length
                lr, lg, lb = _polish(day, gloss, direct, dn * per, de * per, dd * per, nn, ne, nd, lr, lg, lb)

            air = z * length / HAZE_LENGTH_M
            clear = 1.0 / (1.0 + air + 0.5 * air * air)
            lr = day.horizon[0] + (lr - day.horizon[0]) * clear
            lg = day.horizon[1] + (lg - day.horizon[1]) * clear
            lb = day.horizon[2] + (lb - day.horizon[2]) * clear
            color[y, x, 0], color[y, x, 1], color[y, x, 2] = displayed(lr, lg, lb)


@numba.njit(cache=True, nogil=True)
def _polish(day, gloss, direct, dn, de, dd, nn, ne, nd, lr, lg, lb):
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
