"""Collisions of a vehicle, which is modelled as balls, with solid triangles and one moving box.

Every rotor disc is a ball, and so are the hull, the feet and the camera. Bumpers (rows of balls) connect the front
rotors to the camera, so that no pole or board can get behind the camera.

A spring and a damper push a ball out of a surface that it overlaps (Hunt and Crossley, "Coefficient of restitution
interpreted as damping in vibroimpact", Journal of Applied Mechanics, 1975). Both forces grow with the overlap, so they
begin without a jump. The ball leaves no faster than REBOUND_SPEED. All contacts are solved together, with friction and
with the overlaps at the end of the step (sequential impulses, as in Catto, "Iterative dynamics with temporal
coherence", 2005). So a step of 1 ms is stable for any mass and any speed of approach. Contacts change only velocities;
the inertial sensors measure each change.

The search for contacts takes most of the time. Each search notes how far the vehicle may move before the next search.
"""

import math

import numpy as np

from foundation.compiled import Record, njit
from foundation.frames import Quat, Vec3
from foundation.terrain import Obstacles
from vehicles.ground import CRASH_BODY, CRASH_FOOT
from vehicles.records import STEP_S, STEP_US, rotate, rotate_inverse
from vehicles.solids import BALLS, BUMPERS, CANDIDATES, NEAR, SOLIDS, Grid32, SolidTriangles, in_box, in_triangle

# rad/s, resonance of the whole vehicle on the spring of one contact. For the X500, the spring's stiffness is 7.4 kN/m.
# For comparison: 18 kN/m at the end of an arm of 16 mm carbon tube (3 E I / L³), a few kN/m for a plastic guard; the
# obstacle yields too. A bump at 1.2 m/s lasts 56 ms, is 11 mm deep and reaches 96 m/s².
RESONANCE = 60.0
REBOUND_SPEED = 0.4  # m/s, highest rebound; an impact at 1.2 m/s rebounds with 0.31 of its speed, at 0.2 m/s with 0.75
HIT_LEAST = 0.15  # m/s; a contact that begins more slowly is reported as a hit only if it lasts
FRICTION = 0.45  # coefficient of plastic and carbon on dry walls and car bodies
ROUNDS = 8  # iterations over the contacts in a step: enough for four feet on a roof
AHEAD = 0.15  # m; the list of candidate triangles holds for this much motion of the vehicle
TURN = 2.25  # π / √2, rounded up: highest ratio of the angle (rad) between two attitudes to their quaternions' distance
BREAKING = 2.0  # m/s, closing speed above which a propeller breaks
CAMERA_RADIUS = 0.085  # m; in impacts up to 3 m/s, surfaces stay beyond the renderer's near plane
BUMPER_SHARES = (1 / 3, 2 / 3)  # places of a bumper's balls, as shares of the way from a rotor to the camera
BOX = -1  # stands for the moving box in fields with an obstacle's number


@njit(cache=True)
def collide(params: Record, state: Record, solids: Record, near: Record, triangles: SolidTriangles) -> None:
    """Change the motion of the vehicle by its contacts, and note hits in `state`."""
    if solids.here == 0:
        return
    if solids.box != 0:
        _collide_with_box(state, solids, near)
    count = near.box_count
    dx, dy, dz = (
        state.position[0] - near.looked_at[0],
        state.position[1] - near.looked_at[1],
        state.position[2] - near.looked_at[2],
    )
    moved = dx * dx + dy * dy + dz * dz
    if near.free <= AHEAD:  # so close that a turn could bring a ball into contact
        turned = 0.0
        for i in range(4):
            turned += (state.attitude[i] - near.looked_from[i]) ** 2
        moved = 2.0 * (moved + TURN * TURN * turned * solids.reach * solids.reach)
    if not moved < near.free * near.free:
        count = _find_contacts(state, solids, near, triangles, count)
    if count > 0:
        _solve_contacts(params, state, solids, near, count)
        near.free = 0.0  # the next step searches again, because the contacts changed the vehicle's motion


@njit(cache=True)
def ball_centre(state: Record, solids: Record, k: int) -> Vec3:
    """Return the centre (m, NED) of ball k."""
    q = (state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3])
    arm = rotate(q, (solids.ball[k, 0], solids.ball[k, 1], solids.ball[k, 2]))
    return state.position[0] + arm[0], state.position[1] + arm[1], state.position[2] + arm[2]


@njit(cache=True)
def _find_contacts(state: Record, solids: Record, near: Record, triangles: SolidTriangles, count: int) -> int:
    """Find the triangles that balls overlap. Return the number of contacts, including the `count` earlier ones."""
    for i in range(3):
        near.looked_at[i] = state.position[i]
    for i in range(4):
        near.looked_from[i] = state.attitude[i]
    corners, bounds, owner = triangles.corners, triangles.bounds, triangles.owner
    x, y, z = state.position[0], state.position[1], state.position[2]
    dx, dy, dz = x - near.gathered_at[0], y - near.gathered_at[1], z - near.gathered_at[2]
    moved = math.sqrt(dx * dx + dy * dy + dz * dz)
    if not moved < near.holds:
        _gather_candidates(state, solids, near, triangles)
        moved = 0.0
    if near.candidates == 0:
        near.free = near.holds - moved
        return count
    free = near.holds - moved
    for k in range(solids.balls):
        px, py, pz = ball_centre(state, solids, k)
        radius = solids.ball[k, 3]
        best, which, bx, by, bz, face = free + radius, -1, 0.0, 0.0, 0.0, False
        for c in range(near.candidates):
            t = near.candidate[c]
            ex, ey, ez = px - bounds[t, 0], py - bounds[t, 1], pz - bounds[t, 2]
            least = best + bounds[t, 3]
            if ex * ex + ey * ey + ez * ez > least * least:
                continue
            qx, qy, qz, inside = in_triangle(corners, t, px, py, pz)
            gap = math.sqrt((px - qx) ** 2 + (py - qy) ** 2 + (pz - qz) ** 2)
            if gap < best:
                best, which, bx, by, bz, face = gap, t, qx, qy, qz, inside
        if which < 0:
            continue
        free = min(free, max(best - radius, 0.0))
        if best < radius:
            _note(near, corners, count, k, which, best, radius, (px, py, pz), (bx, by, bz), face, owner[which])
            count += 1
    near.free = free
    return count


@njit(cache=True)
def _note(
    near: Record,
    corners: Grid32,
    count: int,
    ball: int,
    which: int,
    gap: float,
    radius: float,
    centre: Vec3,
    point: Vec3,
    face: bool,
    owner: int,
) -> None:
    """Write contact `count` of a ball and a triangle. A ball with its centre behind a face goes out through it."""
    c = corners[which]
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
    nx, ny, nz = nx / size, ny / size, nz / size
    dx, dy, dz = centre[0] - point[0], centre[1] - point[1], centre[2] - point[2]
    depth = radius - gap
    if gap < 1e-6 or (face and dx * nx + dy * ny + dz * nz < 0.0):
        depth = radius + gap
    else:
        nx, ny, nz = dx / gap, dy / gap, dz / gap
    near.ball[count], near.owner[count], near.depth[count] = ball, owner, depth
    near.normal[count, 0], near.normal[count, 1], near.normal[count, 2] = nx, ny, nz
    near.point[count, 0], near.point[count, 1], near.point[count, 2] = point
    near.drift[count, 0] = near.drift[count, 1] = near.drift[count, 2] = 0.0


@njit(cache=True)
def _gather_candidates(state: Record, solids: Record, near: Record, triangles: SolidTriangles) -> None:
    """List the triangles that balls may touch soon, and note the distance of travel for which the list holds."""
    x, y, z = state.position[0], state.position[1], state.position[2]
    for i in range(3):
        near.gathered_at[i] = state.position[i]
    near.candidates = 0
    cell = solids.cell
    u, v, w = (x - solids.origin[0]) / cell, (y - solids.origin[1]) / cell, (z - solids.origin[2]) / cell
    rows, columns, layers = solids.cells[0], solids.cells[1], solids.cells[2]
    outside = max(max(max(-u, u - rows), max(-v, v - columns)), max(-w, w - layers))
    if not outside < 0.0:  # also for NaN
        near.holds = max(outside, 0.0) * cell + 1e-3
        return
    i, j, k = int(u), int(v), int(w)
    u, v, w = u - i, v - j, w - k
    # The cell lists all triangles within the grid's reach, so the list holds until the vehicle leaves the cell, and
    # 1 mm more: `solids.reach` contains this margin.
    holds = cell * min(min(min(u, 1.0 - u), min(v, 1.0 - v)), min(w, 1.0 - w)) + 1e-3
    number = (i * columns + j) * layers + k
    corners, bounds, start = triangles.corners, triangles.bounds, triangles.start
    wide = solids.reach + AHEAD
    nearest = 1e9
    for n in range(start[number], start[number + 1]):
        t = triangles.numbers[n]
        ex, ey, ez = x - bounds[t, 0], y - bounds[t, 1], z - bounds[t, 2]
        square = ex * ex + ey * ey + ez * ez
        least = min(nearest, 1e4) if near.candidates == 0 else wide
        least = max(least, wide) + bounds[t, 3]
        if square > least * least:
            continue
        qx, qy, qz, _ = in_triangle(corners, t, x, y, z)
        gap = math.sqrt((x - qx) ** 2 + (y - qy) ** 2 + (z - qz) ** 2)
        nearest = min(nearest, gap)
        if gap < wide:
            near.candidate[near.candidates] = t
            near.candidates = min(near.candidates + 1, CANDIDATES - 1)
    near.holds = min(holds, nearest - solids.reach if near.candidates == 0 else AHEAD)


@njit(cache=True)
def _collide_with_box(state: Record, solids: Record, near: Record) -> None:
    """Write the contacts with the moving box. They come first in the arrays of `near`."""
    near.box_count = 0
    since = (state.time_us - solids.box_time_us) * 1e-6
    mx = solids.box_centre[0] + solids.box_velocity[0] * since
    my = solids.box_centre[1] + solids.box_velocity[1] * since
    mz = solids.box_centre[2] + solids.box_velocity[2] * since
    dx, dy, dz = state.position[0] - mx, state.position[1] - my, state.position[2] - mz
    if dx * dx + dy * dy + dz * dz > solids.box_reach * solids.box_reach:
        return
    yaw = solids.box_yaw + solids.box_yaw_rate * since
    c, s = math.cos(yaw), math.sin(yaw)
    half = (solids.box_half[0], solids.box_half[1], solids.box_half[2])
    for k in range(solids.balls):
        px, py, pz = ball_centre(state, solids, k)
        ex, ey = px - mx, py - my
        local = (c * ex + s * ey, -s * ex + c * ey, pz - mz)
        gap, point, way = in_box(half, local)
        if gap >= solids.ball[k, 3]:
            continue
        n = near.box_count
        x, y = c * point[0] - s * point[1], s * point[0] + c * point[1]
        near.ball[n], near.owner[n], near.depth[n] = k, BOX, solids.ball[k, 3] - gap
        near.normal[n, 0], near.normal[n, 1] = c * way[0] - s * way[1], s * way[0] + c * way[1]
        near.normal[n, 2] = way[2]
        near.point[n, 0], near.point[n, 1], near.point[n, 2] = mx + x, my + y, mz + point[2]
        near.drift[n, 0] = solids.box_velocity[0] - solids.box_yaw_rate * y
        near.drift[n, 1] = solids.box_velocity[1] + solids.box_yaw_rate * x
        near.drift[n, 2] = solids.box_velocity[2]
        near.box_count += 1


@njit(cache=True)
def _approach(state: Record, near: Record, n: int, q: Quat) -> tuple[Vec3, Vec3]:
    """Return (arm to contact n in m FRD, velocity of this point relative to the obstacle in m/s NED)."""
    arm = rotate_inverse(
        q,
        (
            near.point[n, 0] - state.position[0],
            near.point[n, 1] - state.position[1],
            near.point[n, 2] - state.position[2],
        ),
    )
    p, r, w = state.rates[0], state.rates[1], state.rates[2]
    spin = rotate(q, (r * arm[2] - w * arm[1], w * arm[0] - p * arm[2], p * arm[1] - r * arm[0]))
    return arm, (
        state.velocity[0] + spin[0] - near.drift[n, 0],
        state.velocity[1] + spin[1] - near.drift[n, 1],
        state.velocity[2] + spin[2] - near.drift[n, 2],
    )


@njit(cache=True)
def mobility(params: Record, arm: Vec3, way: Vec3) -> float:
    """Return the change of speed (m/s) of point `arm` (m, FRD) by 1 N·s there, both along unit vector `way` (FRD)."""
    x = arm[1] * way[2] - arm[2] * way[1]
    y = arm[2] * way[0] - arm[0] * way[2]
    z = arm[0] * way[1] - arm[1] * way[0]
    i = params.inertia
    speed: float = 1.0 / params.mass + x * x / i[0] + y * y / i[1] + z * z / i[2]
    return speed


@njit(cache=True)
def _apply_impulse(params: Record, state: Record, q: Quat, arm: Vec3, impulse: Vec3) -> None:
    """Apply an impulse (N·s, NED) at `arm` (m, FRD)."""
    for i in range(3):
        state.velocity[i] += impulse[i] / params.mass
    x, y, z = rotate_inverse(q, impulse)
    state.rates[0] += (arm[1] * z - arm[2] * y) / params.inertia[0]
    state.rates[1] += (arm[2] * x - arm[0] * z) / params.inertia[1]
    state.rates[2] += (arm[0] * y - arm[1] * x) / params.inertia[2]


@njit(cache=True)
def _solve_contacts(params: Record, state: Record, solids: Record, near: Record, count: int) -> None:
    """Apply the normal and friction impulses of `count` contacts over one step, and note new hits."""
    q = (state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3])
    before = (state.velocity[0], state.velocity[1], state.velocity[2])
    for n in range(count):
        _, moving = _approach(state, near, n, q)
        closing = -(moving[0] * near.normal[n, 0] + moving[1] * near.normal[n, 1] + moving[2] * near.normal[n, 2])
        near.stiffness[n] = params.mass * RESONANCE * RESONANCE * max(1.0 + closing / REBOUND_SPEED, 0.0)
        near.pressed[n] = 0.0
        for i in range(3):
            near.rubbed[n, i] = 0.0
        slot = near.ball[n] + BALLS if n < near.box_count else near.ball[n]
        begins = near.touched_us[slot] < state.time_us - STEP_US
        if begins and closing > HIT_LEAST:
            record_hit(state, solids, near.ball[n], near.owner[n], closing)
        near.touched_us[slot] = near.newest_us = state.time_us
        if state.on_ground == 0 and solids.ball_sound[near.ball[n]] != CRASH_FOOT:
            near.leant_us, near.leant_on = state.time_us, near.owner[n]
            if begins:
                near.leant_speed = closing
    for _ in range(ROUNDS):
        for n in range(count):
            normal = (near.normal[n, 0], near.normal[n, 1], near.normal[n, 2])
            arm, moving = _approach(state, near, n, q)
            away = moving[0] * normal[0] + moving[1] * normal[1] + moving[2] * normal[2]
            ease = mobility(params, arm, rotate_inverse(q, normal))
            # implicit: the spring's impulse for the depth that remains at the end of the step
            spring = STEP_S * near.stiffness[n]
            push = (spring * (near.depth[n] - STEP_S * away) - near.pressed[n]) / (1.0 + spring * STEP_S * ease)
            push = max(min(push, (REBOUND_SPEED - away) / ease), -near.pressed[n])
            near.pressed[n] += push
            _apply_impulse(params, state, q, arm, (push * normal[0], push * normal[1], push * normal[2]))
            _apply_friction(params, state, near, n, q, normal)
    felt = rotate_inverse(
        q,
        (
            (state.velocity[0] - before[0]) / STEP_S,
            (state.velocity[1] - before[1]) / STEP_S,
            (state.velocity[2] - before[2]) / STEP_S,
        ),
    )
    for i in range(3):
        state.specific_force[i] += felt[i]


@njit(cache=True)
def _apply_friction(params: Record, state: Record, near: Record, n: int, q: Quat, normal: Vec3) -> None:
    """Apply the friction of contact n: it stops the sliding, within the Coulomb limit of the normal impulse."""
    arm, moving = _approach(state, near, n, q)
    away = moving[0] * normal[0] + moving[1] * normal[1] + moving[2] * normal[2]
    sx, sy, sz = moving[0] - away * normal[0], moving[1] - away * normal[1], moving[2] - away * normal[2]
    speed = math.sqrt(sx * sx + sy * sy + sz * sz)
    if speed < 1e-9:
        return
    ease = speed * mobility(params, arm, rotate_inverse(q, (sx / speed, sy / speed, sz / speed)))
    held = (near.rubbed[n, 0], near.rubbed[n, 1], near.rubbed[n, 2])
    x = held[0] - sx * speed / ease
    y = held[1] - sy * speed / ease
    z = held[2] - sz * speed / ease
    size, most = math.sqrt(x * x + y * y + z * z), FRICTION * near.pressed[n]
    if size > most:
        x, y, z = x * most / size, y * most / size, z * most / size
    near.rubbed[n, 0], near.rubbed[n, 1], near.rubbed[n, 2] = x, y, z
    _apply_impulse(params, state, q, arm, (x - held[0], y - held[1], z - held[2]))


@njit(cache=True)
def record_hit(state: Record, solids: Record, ball: int, owner: int, closing: float) -> None:
    """Note a hit at `closing` (m/s). Above `ball_sound`, it is a crash. Above BREAKING, the ball's propeller breaks."""
    state.hits += 1
    state.hit_speed = closing
    state.hit_owner = owner
    if closing > solids.ball_sound[ball]:
        state.crashed = 1
    rotor = solids.ball_rotor[ball]
    if closing > BREAKING and rotor >= 0:
        state.rotor_health[rotor] = 0.0


def solids_record(params: np.void, obstacles: Obstacles, camera_frd: Vec3 | None) -> np.void:
    """Return the SOLIDS record: a vehicle's balls and the grid of the obstacles.

    Bumpers connect a camera at `camera_frd` (m) to the two nearest rotors.
    """
    record: np.void = np.zeros(1, SOLIDS)[0]
    rotors, radius = int(params["rotors"]), float(params["rotor_radius"])
    hubs = params["rotor_position"][:rotors]
    balls = [(*hub, radius, i, CRASH_BODY) for i, hub in enumerate(hubs)]
    hull = float(np.linalg.norm(hubs, axis=1).min()) - radius
    balls.append((0.0, 0.0, 0.0, max(hull, 0.5 * radius), -1, CRASH_BODY))
    point = max(0.15 * radius, 0.006)  # feet and masts
    for place, foot in zip(params["contact_position"], params["contact_is_foot"], strict=True):
        if foot or (place.any() and np.linalg.norm(hubs - place, axis=1).min() > 1.1 * radius):
            balls.append((*place, point, -1, CRASH_FOOT if foot else CRASH_BODY))
    if camera_frd is not None:
        lens = np.array((*camera_frd, CAMERA_RADIUS))
        balls.append((*lens, -1, CRASH_BODY))
        for hub in sorted(hubs, key=lambda hub: float(np.linalg.norm(hub - camera_frd)))[:BUMPERS]:
            ends = np.array((*hub, radius)), lens
            balls += [(*((1.0 - k) * ends[0] + k * ends[1]), -1, CRASH_BODY) for k in BUMPER_SHARES]
    record["balls"] = len(balls)
    for k, (x, y, z, size, rotor, sound) in enumerate(balls):
        record["ball"][k], record["ball_rotor"][k], record["ball_sound"][k] = (x, y, z, size), rotor, sound
    record["reach"] = max(math.hypot(*ball[:3]) + ball[3] for ball in balls) + 1e-3
    record["origin"], record["cell"], record["cells"] = obstacles.origin_ned, obstacles.cell_m, obstacles.cells
    record["here"] = int(len(obstacles.corners) > 0 or obstacles.moving is not None)
    return record


def fresh_near() -> np.void:
    """Return the NEAR record of a vehicle before its first search for contacts."""
    near: np.void = np.zeros(1, NEAR)[0]
    near["touched_us"] = near["newest_us"] = near["leant_us"] = -2 * STEP_US
    return near
