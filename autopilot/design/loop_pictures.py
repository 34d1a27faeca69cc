"""The designed loops drawn: Bode plots with their margins, and what each does with a step."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autopilot.design.loop_shaping import FREQUENCIES, Gains, Response, closed, loops
from foundation.airframe import Airframe

Array = NDArray[np.float64]

SAMPLES = 1 << 16  # of the inverse transform: 4 ms resolution, or finer, over the slowest loop
GROUPS = (
    ("rate", ("roll rate", "yaw rate")),
    ("attitude", ("roll attitude", "yaw attitude")),
    ("velocity", ("horizontal velocity", "vertical velocity")),
    ("position", ("horizontal position", "vertical position")),
)


def step_response(loop: Response, crossover: float) -> tuple[Array, Array]:
    """Return (time in s, output) of the closed loop to a unit step.

    From the frequency response, which holds the transport delays exactly: the response to a square wave whose half
    period is sixty times the loop's own time, as a Fourier series over its odd harmonics, damped against Gibbs' ripple.
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
    """Return by loop: bandwidth_rad_s (closed loop, -3 dB), rise_s (10 to 90 %) and overshoot_percent of its step."""
    found = {}
    for name, loop in loops(airframe, gains).items():
        time, output = step_response(loop, gains.margins[name].crossover)
        size = np.abs(closed(loop)(1j * FREQUENCIES))
        above = np.flatnonzero(size >= np.sqrt(0.5))
        rise = time[np.argmax(output >= 0.9)] - time[np.argmax(output >= 0.1)]
        found[name] = {
            "bandwidth_rad_s": round(float(FREQUENCIES[above[-1]]), 3),
            "rise_s": round(float(rise), 4),
            "overshoot_percent": round(max(float(output.max()) - 1.0, 0.0) * 100.0, 1),
        }
    return found


def draw(airframe: Airframe, gains: Gains, folder: Path) -> list[Path]:
    """Draw NAME-bode.png and NAME-steps.png into a folder; return their paths."""
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    found = loops(airframe, gains)
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
            margin, value = gains.margins[name], found[name](1j * FREQUENCIES)
            phase = np.degrees(np.unwrap(np.angle(value)))
            phase -= 360.0 * round((phase[0] + 135.0) / 360.0)
            label = f"{name.split()[0]}: {margin.phase_deg:.0f}°, {margin.gain_db:.0f} dB"
            top.semilogx(omega, 20.0 * np.log10(np.abs(value))[shown], color=f"C{k}", label=label)
            bottom.semilogx(omega, phase[shown], color=f"C{k}")
            top.axvline(margin.crossover, color=f"C{k}", linewidth=0.7, linestyle=":")
            bottom.axvline(margin.crossover, color=f"C{k}", linewidth=0.7, linestyle=":")
            time, output = step_response(found[name], margin.crossover)
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
        for one in (top, bottom, panel):
            one.grid(visible=True, which="major", linewidth=0.3)
    axes[0, 0].set_ylabel("gain (dB)")
    axes[1, 0].set_ylabel("phase (°)")
    bode.suptitle(f"{airframe.name}: open loops; dotted: crossover; in the legends phase and gain margin")
    steps.suptitle(f"{airframe.name}: closed loops")
    paths = [folder / f"{airframe.name}-bode.png", folder / f"{airframe.name}-steps.png"]
    bode.savefig(paths[0], dpi=110)
    steps.savefig(paths[1], dpi=110)
    return paths
