"""Designs an airframe's gains from its constants by loop shaping; draws Bode plots and step responses of the loops.

Each loop is a function L(s) of the complex frequency. It combines controller, actuator lag, filters, transport delay
and closed inner loop. The rate loops are as fast as their margins allow. Each outer loop is slower than its inner loop
by at least a fixed ratio. Every loop of every design has at least 45° of phase margin and 6 dB of gain margin.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autopilot.control.mixer import allocation
from autopilot.control.position import RESPONSE
from foundation.airframe import Airframe
from foundation.errors import UsageError
from foundation.frames import GRAVITY, Vec3

Complex = NDArray[np.complexfloating[Any, Any]]
Response = Callable[[Complex], Complex]

PHASE_MARGIN_MIN = 45.0  # deg
GAIN_MARGIN_MIN = 6.0  # dB
FREQUENCIES = np.geomspace(0.01, 1500.0, 3000)  # rad/s

RATE_DELAY_S = 0.002  # delay of sampling, computing and holding at 1 kHz
OUTER_DELAY_S = 0.015  # delay of holding at 100 Hz and of the estimator's smoothing
RATE_PHASE_MARGIN = 60.0  # deg, design target; a weak battery or a payload may reduce the margin
RATE_GAIN_MARGIN = 9.0  # dB, design target
ATTITUDE_RATIO = 3.5  # rate P gain / attitude P gain
ATTITUDE_P_MAX = 8.0  # 1/s; a higher gain only passes noise of the outer loops to the rotors
YAW_CROSSOVER_MAX = 8.0  # rad/s; yaw torque is weak, and has the lowest priority in the mixer
VELOCITY_RATIO = 3.2  # attitude P gain / velocity P gain; an X500 gets the velocity gain 2.0
VELOCITY_P_MAX = (2.0, 2.0, 4.0)  # 1/s; PX4's defaults: 1.8 (MPC_XY_VEL_P_ACC) and 4 (MPC_Z_VEL_P_ACC)
ROTOR_FLOOR = 0.01  # least thrust fraction of a rotor, even without an idle speed


@dataclass(frozen=True, slots=True)
class Margin:
    """The stability margins of a loop."""

    phase_deg: float
    gain_db: float  # inf if the phase never reaches -180°
    crossover: float  # rad/s


@dataclass(frozen=True, slots=True)
class Gains:
    """The gains of the cascade for an airframe. Vectors are in the order roll, pitch, yaw or north, east, down."""

    rate_p: Vec3  # rad/s² per rad/s
    rate_i: Vec3  # rad/s² per rad
    rate_d: Vec3  # rad/s² per rad/s²
    attitude_p: Vec3  # 1/s
    velocity_p: Vec3  # m/s² per m/s
    velocity_i: Vec3  # m/s² per m
    velocity_d: Vec3  # m/s² per m/s²
    position_p: Vec3  # 1/s
    velocity_lag: Vec3  # s, lag of the acceleration behind its setpoint, and so of the velocity behind its reference
    yaw_lag: float  # s, lag of the yaw rate behind its setpoint
    gyro_cutoff_hz: float
    gyro_derivative_cutoff_hz: float
    acceleration_max: Vec3  # rad/s², angular acceleration of a normalised torque of 1
    hover_thrust: float  # 0 … 1, fraction of the full collective
    rotor_thrust_min: float  # 0 … 1, fraction of a rotor's full thrust at idle speed
    margins: dict[str, Margin]  # by loop, with the keys of `loops`


def lag(time_constant: float) -> Response:
    """Return 1 / (T s + 1)."""
    return lambda s: 1.0 / (time_constant * s + 1.0)


def rotor_lag(airframe: Airframe) -> float:
    """Return the mean time constant (s) of spinning up and down."""
    return 0.5 * (airframe.curve.time_constant_up_s + airframe.curve.time_constant_down_s)


def hover_thrust(airframe: Airframe) -> float:
    """Return the collective (0 … 1) that carries the weight."""
    return airframe.mass_kg * GRAVITY / airframe.thrust_max


def yaw_lead(airframe: Airframe) -> float:
    """Return the time (s) by which the yaw torque leads the rotor speed.

    A rotor's yaw torque is its drag plus the torque that accelerates its inertia J. Near hover, the change of torque
    per change of rotor speed ω is 2 kq ω + J s, so the lead is J / (2 kq ω).
    """
    speed = airframe.curve.speed_max * math.sqrt(hover_thrust(airframe))
    return airframe.curve.inertia / (2.0 * airframe.curve.torque_coefficient * speed)


def rate_loop(
    airframe: Airframe, p: float, i: float, d: float, cutoff_hz: float, derivative_hz: float, yaw: bool
) -> Response:
    """Return L(s) of a rate PID around rotor lag, gyro filters and delay."""
    rotor, gyro, slope = (
        lag(rotor_lag(airframe)),
        lag(1 / (2 * math.pi * cutoff_hz)),
        lag(1 / (2 * math.pi * derivative_hz)),
    )
    lead = yaw_lead(airframe) if yaw else 0.0

    def response(s: Complex) -> Complex:
        controller = p + i / s + d * s * slope(s)
        loop: Complex = controller * (1.0 + lead * s) * rotor(s) * gyro(s) * np.exp(-RATE_DELAY_S * s) / s
        return loop

    return response


def closed(loop: Response) -> Response:
    """Return L / (1 + L)."""
    return lambda s: loop(s) / (1.0 + loop(s))


def attitude_loop(p: float, rate: Response) -> Response:
    """Return L(s) of an attitude P controller around a rate loop."""
    inner = closed(rate)
    return lambda s: p / s * inner(s) * np.exp(-0.001 * s)


def velocity_loop(p: float, i: float, d: float, inner: Response) -> Response:
    """Return L(s) of a velocity PID around `inner`, from acceleration setpoint to acceleration."""
    measured = lag(1 / (2 * math.pi * 10.0))  # the cascade's filter of the measured acceleration
    return lambda s: (p + i / s + d * s * measured(s)) / s * inner(s) * np.exp(-OUTER_DELAY_S * s)


def position_loop(p: float, velocity: Response, inner: Response, expected: float) -> Response:
    """Return L(s) of a position P controller around the smoothing of the velocity setpoint and the velocity loop.

    G, `inner` with its delay, turns the acceleration setpoint into the acceleration. This setpoint is a sum. The
    feed-forward is s r, the derivative of the smoothed velocity setpoint r. The feedback is the output of the
    controller C. Its input is the expected velocity r / (T s + 1) minus the velocity; T is `expected` (s). With
    L = C G / s, the velocity is (G + L / (T s + 1)) / (1 + L) r.
    """
    smoothing, late = lag(1.0 / RESPONSE), lag(expected)
    return lambda s: (
        p / s * smoothing(s) * (inner(s) * np.exp(-OUTER_DELAY_S * s) + velocity(s) * late(s)) / (1.0 + velocity(s))
    )


def margin(loop: Response, frequencies: NDArray[np.float64] = FREQUENCIES) -> Margin:
    """Return a loop's smallest phase and gain margin over all crossings; phase nan if the loop never crosses 0 dB."""
    value = loop(1j * frequencies)
    gain = 20.0 * np.log10(np.abs(value))
    phase = np.degrees(np.unwrap(np.angle(value)))
    phase -= 360.0 * round((phase[0] + 135.0) / 360.0)  # with one or two integrators the phase begins at -90° to -180°
    crossings = np.flatnonzero(gain[:-1] * gain[1:] < 0.0)
    phases, where = [], math.nan
    for k in crossings:
        share = gain[k] / (gain[k] - gain[k + 1])
        phases.append(180.0 + phase[k] + share * (phase[k + 1] - phase[k]))
        where = frequencies[k] * (frequencies[k + 1] / frequencies[k]) ** share
    turns = np.flatnonzero((phase[:-1] + 180.0) * (phase[1:] + 180.0) < 0.0)
    gains = []
    for k in turns:
        share = (phase[k] + 180.0) / (phase[k] - phase[k + 1])
        gains.append(-(gain[k] + share * (gain[k + 1] - gain[k])))
    return Margin(float(min(phases, default=math.nan)), float(min(gains, default=math.inf)), float(where))


def shape_rate(airframe: Airframe, cutoff_hz: float, derivative_hz: float, yaw: bool) -> tuple[float, float, float]:
    """Return (p, i, d) of the fastest rate loop with the target margins. Raises UsageError if there is none."""
    lead = 0.0 if yaw else 0.6 * rotor_lag(airframe)  # s, derivative time: compensates most of the rotor lag
    top = YAW_CROSSOVER_MAX if yaw else 1.0 / rotor_lag(airframe)
    for p in np.geomspace(top, 0.02 * top, 120):
        i, d = (0.05 if yaw else 0.15) * p * p, lead * p
        result = margin(rate_loop(airframe, p, i, d, cutoff_hz, derivative_hz, yaw), FREQUENCIES[::6])
        if result.phase_deg >= RATE_PHASE_MARGIN and result.gain_db >= RATE_GAIN_MARGIN:
            return float(p), float(i), float(d)
    raise UsageError(f"airframe {airframe.name!r} has no stable rate loop. Check its rotor time constants")


def loops(airframe: Airframe, gains: Gains) -> dict[str, Response]:
    """Return the open loops L(s) of the designed cascade by name, from the innermost out."""
    filters = (gains.gyro_cutoff_hz, gains.gyro_derivative_cutoff_hz)
    rate = {
        axis: rate_loop(airframe, gains.rate_p[k], gains.rate_i[k], gains.rate_d[k], *filters, axis == "yaw")
        for k, axis in enumerate(("roll", "pitch", "yaw"))
    }
    attitude = {axis: attitude_loop(gains.attitude_p[k], loop) for k, (axis, loop) in enumerate(rate.items())}
    p, i, d = gains.velocity_p, gains.velocity_i, gains.velocity_d
    tilting, lifting = closed(attitude["pitch"]), lag(rotor_lag(airframe))
    horizontal = velocity_loop(p[0], i[0], d[0], tilting)
    vertical = velocity_loop(p[2], i[2], d[2], lifting)
    late = gains.velocity_lag
    return {
        **{f"{axis} rate": loop for axis, loop in rate.items()},
        **{f"{axis} attitude": loop for axis, loop in attitude.items()},
        "horizontal velocity": horizontal,
        "vertical velocity": vertical,
        "horizontal position": position_loop(gains.position_p[0], horizontal, tilting, late[0]),
        "vertical position": position_loop(gains.position_p[2], vertical, lifting, late[2]),
    }


@lru_cache(maxsize=32)
def design(airframe: Airframe) -> Gains:
    """Return the gains of an airframe, with the margins of its loops.

    Raises UsageError if the airframe cannot be controlled, or a loop has a margin below 45° or 6 dB.
    """
    share = allocation(airframe)
    hover = hover_thrust(airframe)
    if not 0.05 < hover < 0.8:
        raise UsageError(
            f"airframe {airframe.name!r} hovers at {hover:.0%} of its full thrust. It needs between 5 % and 80 %;"
            " check its mass and rotors"
        )
    # filter cutoffs are 10 and 6 times the fastest crossover that the rotors allow, within PX4's usual range
    cutoff_hz = min(max(1.6 / rotor_lag(airframe), 60.0), 120.0)
    derivative_hz = min(max(1.0 / rotor_lag(airframe), 30.0), 80.0)
    level = shape_rate(airframe, cutoff_hz, derivative_hz, yaw=False)
    turn = shape_rate(airframe, cutoff_hz, derivative_hz, yaw=True)
    rate = (level, level, turn)
    tilt_p = min(level[0] / ATTITUDE_RATIO, ATTITUDE_P_MAX)
    attitude_p = (tilt_p, tilt_p, min(turn[0] / ATTITUDE_RATIO, tilt_p))
    sideways = min(tilt_p / VELOCITY_RATIO, VELOCITY_P_MAX[0])
    upright = min(0.16 / rotor_lag(airframe), VELOCITY_P_MAX[2])
    tilt_lag = 1.0 / tilt_p + 1.0 / level[0] + OUTER_DELAY_S
    (roll, pitch, yaw), inertia = share.torque_max, airframe.inertia_frd
    floor = (airframe.curve.speed_idle / airframe.curve.speed_max) ** 2
    gains = Gains(
        rate_p=(rate[0][0], rate[1][0], rate[2][0]),
        rate_i=(rate[0][1], rate[1][1], rate[2][1]),
        rate_d=(rate[0][2], rate[1][2], rate[2][2]),
        attitude_p=attitude_p,
        velocity_p=(sideways, sideways, upright),
        velocity_i=(0.3 * sideways**2, 0.3 * sideways**2, 0.08 * upright**2),
        velocity_d=(0.1 * sideways, 0.1 * sideways, 0.0),
        position_p=(0.5 * sideways, 0.5 * sideways, 0.3 * upright),
        velocity_lag=(tilt_lag, tilt_lag, rotor_lag(airframe) + OUTER_DELAY_S),
        yaw_lag=1.0 / turn[0],
        gyro_cutoff_hz=cutoff_hz,
        gyro_derivative_cutoff_hz=derivative_hz,
        acceleration_max=(roll / inertia[0], pitch / inertia[1], yaw / inertia[2]),
        hover_thrust=hover,
        rotor_thrust_min=max(floor, ROTOR_FLOOR),
        margins={},
    )
    for name, loop in loops(airframe, gains).items():
        result = margin(loop)
        gains.margins[name] = result
        if not (result.phase_deg >= PHASE_MARGIN_MIN and result.gain_db >= GAIN_MARGIN_MIN):
            raise UsageError(
                f"the {name} loop of airframe {airframe.name!r} keeps only {result.phase_deg:.0f}° and "
                f"{result.gain_db:.1f} dB margin. Check its inertia, rotors and time constants"
            )
    return gains


def margins_by_control(airframe: Airframe, gains: Gains) -> dict[str, Margin]:
    """Return the margins of every loop as python-control computes them from the frequency responses.

    This checks `margin` independently. `design` does not call it, because the import of python-control takes a second.
    """
    import control

    result = {}
    for name, loop in loops(airframe, gains).items():
        response = control.FRD(loop(1j * FREQUENCIES), FREQUENCIES)
        gain, phase, _, _, crossover, _ = control.stability_margins(response)
        result[name] = Margin(float(phase), 20.0 * math.log10(gain), float(crossover))
    return result


Array = NDArray[np.float64]

SAMPLES = 1 << 16  # samples of a square wave; for the slowest loop, at most 4 ms apart
GROUPS = (
    ("rate", ("roll rate", "yaw rate")),
    ("attitude", ("roll attitude", "yaw attitude")),
    ("velocity", ("horizontal velocity", "vertical velocity")),
    ("position", ("horizontal position", "vertical position")),
)


def step_response(loop: Response, crossover: float) -> tuple[Array, Array]:
    """Return (time in s, output) of the closed loop after a unit step.

    The output comes from the frequency response, so transport delays are exact. The input is a square wave with a half
    period of 60 / crossover. The output is a Fourier series of odd harmonics, damped against Gibbs' ripple.
    """
    half = 60.0 / crossover
    harmonic = np.arange(1, SAMPLES // 8, 2)
    omega = harmonic * np.pi / half
    value = closed(loop)(1j * omega) * np.sinc(harmonic / harmonic[-1])
    spectrum = np.zeros(SAMPLES, np.complex128)
    spectrum[harmonic] = value * 2.0 / (np.pi * 1j * harmonic)
    wave = np.fft.ifft(spectrum).real * SAMPLES
    time = np.arange(SAMPLES) * 2.0 * half / SAMPLES
    kept = time < 0.4 * half
    return time[kept], 0.5 + wave[kept]


def step_figures(airframe: Airframe, gains: Gains) -> dict[str, dict[str, float]]:
    """Return by loop: bandwidth_rad_s (closed loop, -3 dB), rise_s (10 to 90 %) and overshoot_percent of the step."""
    result = {}
    for name, loop in loops(airframe, gains).items():
        time, output = step_response(loop, gains.margins[name].crossover)
        size = np.abs(closed(loop)(1j * FREQUENCIES))
        above = np.flatnonzero(size >= np.sqrt(0.5))
        rise = time[np.argmax(output >= 0.9)] - time[np.argmax(output >= 0.1)]
        result[name] = {
            "bandwidth_rad_s": round(float(FREQUENCIES[above[-1]]), 3),
            "rise_s": round(float(rise), 4),
            "overshoot_percent": round(max(float(output.max()) - 1.0, 0.0) * 100.0, 1),
        }
    return result


def draw(airframe: Airframe, gains: Gains, folder: Path) -> list[Path]:
    """Draw NAME-bode.png and NAME-steps.png into a folder; return their paths."""
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    result = loops(airframe, gains)
    bode = Figure(figsize=(11.0, 7.0), layout="constrained")
    axes = bode.subplots(2, len(GROUPS), sharex="col", sharey="row")
    steps = Figure(figsize=(11.0, 3.4), layout="constrained")
    panels = steps.subplots(1, len(GROUPS), sharey=True)
    for column, (title, members) in enumerate(GROUPS):
        top, bottom, panel = axes[0, column], axes[1, column], panels[column]
        middle = max(gains.margins[name].crossover for name in members)
        shown = np.abs(np.log(FREQUENCIES / middle)) < np.log(50.0)
        omega, longest = FREQUENCIES[shown], 0.0
        for k, name in enumerate(members):
            margin, value = gains.margins[name], result[name](1j * FREQUENCIES)
            phase = np.degrees(np.unwrap(np.angle(value)))
            phase -= 360.0 * round((phase[0] + 135.0) / 360.0)
            label = f"{name.split()[0]}: {margin.phase_deg:.0f}°, {margin.gain_db:.0f} dB"
            top.semilogx(omega, 20.0 * np.log10(np.abs(value))[shown], color=f"C{k}", label=label)
            bottom.semilogx(omega, phase[shown], color=f"C{k}")
            top.axvline(margin.crossover, color=f"C{k}", linewidth=0.7, linestyle=":")
            bottom.axvline(margin.crossover, color=f"C{k}", linewidth=0.7, linestyle=":")
            time, output = step_response(result[name], margin.crossover)
            panel.plot(time, output, color=f"C{k}", label=name.split()[0])
            longest = max(longest, 9.0 / margin.crossover)
        top.axhline(0.0, color="black", linewidth=0.6)
        bottom.axhline(-180.0, color="black", linewidth=0.6)
        top.set(title=f"{title} loops", ylim=(-40.0, 40.0))
        bottom.set(xlabel="rad/s", ylim=(-270.0, -45.0), yticks=np.arange(-270.0, -44.0, 45.0))
        top.legend(fontsize=8, loc="upper right")
        panel.set(title=f"{title} step", xlabel="s", xlim=(0.0, longest), ylim=(-0.1, 1.4))
        panel.axhline(1.0, color="black", linewidth=0.6)
        panel.legend(fontsize=8, loc="lower right")
        for chart in (top, bottom, panel):
            chart.grid(visible=True, which="major", linewidth=0.3)
    axes[0, 0].set_ylabel("gain (dB)")
    axes[1, 0].set_ylabel("phase (°)")
    bode.suptitle(f"{airframe.name}: open loops; dotted: crossover; in the legends phase and gain margin")
    steps.suptitle(f"{airframe.name}: closed loops")
    paths = [folder / f"{airframe.name}-bode.png", folder / f"{airframe.name}-steps.png"]
    bode.savefig(paths[0], dpi=110)
    steps.savefig(paths[1], dpi=110)
    return paths
