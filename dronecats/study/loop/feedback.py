"""Simulates a vehicle with a delay in the feedback of one control loop, to measure the loop's delay margin.

The cascade gets a copy of the estimate in which one quantity of one axis is delayed. The samples that the estimator
reads are not delayed. Flights do not use this module; they use `dronecats/flight/sitl/fused.py`.
"""

import math

from autopilot.control.cascade import update as control
from autopilot.estimator.ekf import update as estimate_motion
from autopilot.records import quat_conjugate, quat_multiply, rotate, rotate_inverse
from foundation.compiled import Grid, Record, njit
from foundation.frames import Vec3
from vehicles.multirotor import step
from vehicles.solids import SolidTriangles

RATE, ATTITUDE, VELOCITY = 0, 1, 2  # values of `loop`: the control loop whose feedback is delayed
DELAY_LINE_ROWS = 4096  # samples in a delay line, one per millisecond
CHANNELS = 4  # values in a sample of a delay line; a quaternion needs all four
COLUMNS = 10  # columns of the recorded truth: rates FRD (rad/s), attitude (w, x, y, z), velocity NED (m/s)


@njit(cache=True)
def delayed(line: Grid, newest: int, channel: int, delay: float) -> float:
    """Return a channel's value `delay` samples before the newest sample of a line, interpolated linearly."""
    samples = int(delay)
    share = delay - samples
    rows = line.shape[0]
    newer = line[(newest - samples) % rows, channel]
    older = line[(newest - samples - 1) % rows, channel]
    value: float = newer + share * (older - newer)
    return value


@njit(cache=True)
def acceleration(estimate: Record) -> Vec3:
    """Return the measured specific force in NED (m/s²)."""
    q, s = estimate.attitude, estimate.accel_frd
    turned: Vec3 = rotate((q[0], q[1], q[2], q[3]), (s[0], s[1], s[2]))
    return turned


@njit(cache=True)
def record_feedback(loop: int, axis: int, estimate: Record, line: Grid, row: int) -> None:
    """Write the current feedback of a loop into a row of its delay line."""
    if loop == RATE:
        line[row, 0] = estimate.rates_frd[axis]
    elif loop == ATTITUDE:
        for i in range(4):
            line[row, i] = estimate.attitude[i]
    else:
        line[row, 0] = estimate.velocity_ned[axis]
        line[row, 1] = acceleration(estimate)[axis]


@njit(cache=True)
def delay_feedback(
    loop: int, axis: int, delay: float, derivative: bool, estimate: Record, seen: Record, line: Grid, newest: int
) -> None:
    """Copy the estimate into `seen`, with one loop's feedback on one axis delayed by `delay` samples.

    For an attitude loop, only the rotation about that body axis is delayed. `derivative`: whether a velocity loop has
    a derivative term; then the acceleration on the axis is delayed, too.
    """
    seen.time_us = estimate.time_us
    seen.velocity_valid = estimate.velocity_valid
    seen.position_valid = estimate.position_valid
    for i in range(4):
        seen.attitude[i] = estimate.attitude[i]
    for i in range(3):
        seen.rates_frd[i] = estimate.rates_frd[i]
        seen.accel_frd[i] = estimate.accel_frd[i]
        seen.velocity_ned[i] = estimate.velocity_ned[i]
        seen.position_ned[i] = estimate.position_ned[i]
    if delay <= 0.0:
        return
    if loop == RATE:
        seen.rates_frd[axis] = delayed(line, newest, 0, delay)
    elif loop == ATTITUDE:
        now = (estimate.attitude[0], estimate.attitude[1], estimate.attitude[2], estimate.attitude[3])
        then = (
            delayed(line, newest, 0, delay),
            delayed(line, newest, 1, delay),
            delayed(line, newest, 2, delay),
            delayed(line, newest, 3, delay),
        )
        back = quat_multiply(quat_conjugate(now), then)
        half = math.atan2(back[1 + axis], back[0])
        most = math.sin(half)
        turn = (math.cos(half), most if axis == 0 else 0.0, most if axis == 1 else 0.0, most if axis == 2 else 0.0)
        q = quat_multiply(now, turn)
        for i in range(4):
            seen.attitude[i] = q[i]
    else:
        seen.velocity_ned[axis] = delayed(line, newest, 0, delay)
        if derivative:
            a = acceleration(estimate)
            was = delayed(line, newest, 1, delay)
            q = estimate.attitude
            felt = rotate_inverse(
                (q[0], q[1], q[2], q[3]),
                (was if axis == 0 else a[0], was if axis == 1 else a[1], was if axis == 2 else a[2]),
            )
            for i in range(3):
                seen.accel_frd[i] = felt[i]


@njit(cache=True)
def simulate_with_delay(
    loop: int,
    axis: int,
    delay: float,
    out: Grid,
    line: Grid,
    seen: Record,
    plant: Record,
    down: Grid,
    peak: Grid,
    triangles: SolidTriangles,
    params: Record,
    state: Record,
    filter_params: Record,
    filter_state: Record,
    covariance: Grid,
    history: Grid,
    setpoint: Record,
    estimate: Record,
) -> None:
    """Advance by one millisecond per row of `out` (n, COLUMNS) and write the truth into that row.

    loop, axis: select the delayed feedback. delay: samples, with a fraction, at most DELAY_LINE_ROWS - 2. `line`
    (DELAY_LINE_ROWS, CHANNELS) and `seen` (an ESTIMATE record) are scratch buffers. `Multirotor.kernel_args` and
    `FlightCore.kernel_args` provide the other arguments.
    """
    for row in range(line.shape[0]):
        record_feedback(loop, axis, estimate, line, row)
    derivative = params.velocity_d[axis] > 0.0
    newest = 0
    for k in range(out.shape[0]):
        step(plant, down, peak, triangles)
        on_ground = setpoint.armed == 0
        if estimate_motion(filter_params, filter_state, covariance, history, plant.sensors, estimate, on_ground):
            newest = (newest + 1) % line.shape[0]
            record_feedback(loop, axis, estimate, line, newest)
            delay_feedback(loop, axis, delay, derivative, estimate, seen, line, newest)
            control(params, state, setpoint, seen, plant.actuators)
        truth = plant.truth
        for i in range(3):
            out[k, i] = truth.rates_frd[i]
            out[k, 7 + i] = truth.velocity_ned[i]
        for i in range(4):
            out[k, 3 + i] = truth.attitude[i]
