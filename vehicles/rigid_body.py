"""Six degrees of freedom: the derivative of motion, and one Runge-Kutta step of it.

The rotors' force, moment and angular momentum are constant in body axes over a step; air drag, gravity and the
ground are evaluated at each of the four stages. Rotation is Euler's equation with the rotors as gyroscopes:
    I · dω/dt = M - ω × (I · ω + h)
"""

from foundation.compiled import Grid, Record, njit
from foundation.frames import GRAVITY, Quat, Vec3
from vehicles.ground import support
from vehicles.records import STEP_S, Load, quat_normalized, rotate, rotate_inverse


@njit(cache=True)
def _moved(a: Vec3, b: Vec3, s: float) -> Vec3:
    return (a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s)


@njit(cache=True)
def _turned(a: Quat, b: Quat, s: float) -> Quat:
    return (a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s, a[3] + b[3] * s)


@njit(cache=True)
def _mean(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> Vec3:
    """Return the weighted mean of the four stages, per component."""
    return (
        (a[0] + 2.0 * (b[0] + c[0]) + d[0]) / 6.0,
        (a[1] + 2.0 * (b[1] + c[1]) + d[1]) / 6.0,
        (a[2] + 2.0 * (b[2] + c[2]) + d[2]) / 6.0,
    )


@njit(cache=True)
def air_drag(params: Record, air: Vec3) -> Vec3:
    """Return the drag (N, FRD) of the frame at the velocity `air` (m/s, FRD) through the air."""
    return (
        -(params.drag_linear[0] + params.drag_quadratic[0] * abs(air[0])) * air[0],
        -(params.drag_linear[1] + params.drag_quadratic[1] * abs(air[1])) * air[1],
        -(params.drag_linear[2] + params.drag_quadratic[2] * abs(air[2])) * air[2],
    )


@njit(cache=True)
def derivative(
    params: Record,
    state: Record,
    down: Grid,
    load: Load,
    wind: Vec3,
    mask: int,
    position: Vec3,
    velocity: Vec3,
    attitude: Quat,
    rates: Vec3,
) -> tuple[Vec3, Quat, Vec3]:
    """Return (acceleration m/s² NED, attitude rate 1/s, angular acceleration rad/s² FRD).

    `load` is (force N FRD, moment N·m FRD, rotor angular momentum about z); `wind` is m/s NED,
    `down` the terrain's NED z (m) on a grid, and `mask` has one bit per contact point that may touch the ground.
    """
    force, moment, momentum = load
    air = rotate_inverse(attitude, (velocity[0] - wind[0], velocity[1] - wind[1], velocity[2] - wind[2]))
    drag = air_drag(params, air)
    ax, ay, az = rotate(attitude, (force[0] + drag[0], force[1] + drag[1], force[2] + drag[2]))
    mx, my, mz = moment
    if mask != 0:
        ground, turn = support(params, state, down, mask, position, attitude, velocity, rates)
        ax, ay, az = ax + ground[0], ay + ground[1], az + ground[2]
        tx, ty, tz = rotate_inverse(attitude, turn)
        mx, my, mz = mx + tx, my + ty, mz + tz
    ax += state.external_force[0]
    ay += state.external_force[1]
    az += state.external_force[2]
    ix, iy, iz = params.inertia[0], params.inertia[1], params.inertia[2]
    p, q, r = rates
    hx, hy, hz = ix * p, iy * q, iz * r + momentum
    turning = (
        (mx + state.external_torque[0] - (q * hz - r * hy)) / ix,
        (my + state.external_torque[1] - (r * hx - p * hz)) / iy,
        (mz + state.external_torque[2] - (p * hy - q * hx)) / iz,
    )
    w, x, y, z = attitude
    attitude_rate = (
        0.5 * (-x * p - y * q - z * r),
        0.5 * (w * p + y * r - z * q),
        0.5 * (w * q - x * r + z * p),
        0.5 * (w * r + x * q - y * p),
    )
    mass = params.mass
    return (ax / mass, ay / mass, az / mass + GRAVITY), attitude_rate, turning


@njit(cache=True)
def move(params: Record, state: Record, down: Grid, load: Load, wind: Vec3, mask: int) -> None:
    """Advance the motion in `state` by one step (RK4); store the mean rates and the specific force."""
    h = STEP_S
    half = 0.5 * h
    p = (state.position[0], state.position[1], state.position[2])
    v = (state.velocity[0], state.velocity[1], state.velocity[2])
    q = (state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3])
    w = (state.rates[0], state.rates[1], state.rates[2])

    a1, q1, w1 = derivative(params, state, down, load, wind, mask, p, v, q, w)
    v2 = _moved(v, a1, half)
    a2, q2, w2 = derivative(
        params, state, down, load, wind, mask, _moved(p, v, half), v2, _turned(q, q1, half), _moved(w, w1, half)
    )
    v3 = _moved(v, a2, half)
    a3, q3, w3 = derivative(
        params, state, down, load, wind, mask, _moved(p, v2, half), v3, _turned(q, q2, half), _moved(w, w2, half)
    )
    v4 = _moved(v, a3, h)
    a4, q4, w4 = derivative(
        params, state, down, load, wind, mask, _moved(p, v3, h), v4, _turned(q, q3, h), _moved(w, w3, h)
    )

    acceleration = _mean(a1, a2, a3, a4)
    state.position[0], state.position[1], state.position[2] = _moved(p, _mean(v, v2, v3, v4), h)
    state.velocity[0], state.velocity[1], state.velocity[2] = _moved(v, acceleration, h)
    state.rates[0], state.rates[1], state.rates[2] = _moved(w, _mean(w1, w2, w3, w4), h)
    turned_at = _mean(w, _moved(w, w1, half), _moved(w, w2, half), _moved(w, w3, h))
    state.mean_rates[0], state.mean_rates[1], state.mean_rates[2] = turned_at
    turned = quat_normalized(
        (
            q[0] + h * (q1[0] + 2.0 * (q2[0] + q3[0]) + q4[0]) / 6.0,
            q[1] + h * (q1[1] + 2.0 * (q2[1] + q3[1]) + q4[1]) / 6.0,
            q[2] + h * (q1[2] + 2.0 * (q2[2] + q3[2]) + q4[2]) / 6.0,
            q[3] + h * (q1[3] + 2.0 * (q2[3] + q3[3]) + q4[3]) / 6.0,
        )
    )
    state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3] = turned
    # the mean over the step, as a real accelerometer integrates: its sum matches the change of velocity
    felt = rotate_inverse(turned, (acceleration[0], acceleration[1], acceleration[2] - GRAVITY))
    state.specific_force[0], state.specific_force[1], state.specific_force[2] = felt
