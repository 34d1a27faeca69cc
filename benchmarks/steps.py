"""Measures the step responses and the hover drift of every airframe, with simulated sensors and the whole autopilot.

    python -m benchmarks.steps [--json] [--plots DIR] [--table FILE] [--airframe NAME …] [--short]

All figures are computed from the true state. A response is the mean of five flights with different sensor errors, to
average these out. Rise: time from 10 to 90 % of the step. Overshoot: in % of the step. Steady error: difference between
the step and the mean response of the last three seconds, in % of the step.

The hold error is the largest horizontal distance between the estimate and the setpoint in a minute of hover in still
air. It is the error of control alone, without the error of the estimate, which control cannot see. The drift is the
largest true distance from the start, horizontal (caused by the GPS receiver) and vertical (caused by the barometer).
The table shows the hold error and the horizontal drift as the median of the five flights, and the largest drift in
brackets. `--short` flies one airframe once and only checks that everything runs.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autopilot.records import NAN, CascadeSetpoint
from benchmarks.flight import CoreFlight
from benchmarks.machine import benchmark_parser
from dronecats.flight.sitl.simulation import TICK_US, BootPose, SimulatedVehicle
from foundation.frames import PX4_HOME, quat_yaw, vec3, wrap_pi
from vehicles import airframe

Array = NDArray[np.float64]

HEIGHT_M = 10.0
TICK_S = TICK_US / 1e6
STREAM_TICKS = 5  # a setpoint every 50 ms, as an agent sends them
SEEDS = (1, 2, 3, 4, 5)
OVERSHOOT_MOST, STEADY_MOST, HOLD_MOST = 10.0, 2.0, 0.3  # goals: overshoot (%), steady error (%), hold error (m)


@dataclass(frozen=True, slots=True)
class Step:
    """A step of one component of the setpoint."""

    name: str
    size: float  # in `unit`
    seconds: float
    unit: str  # of size and response: m/s, rad or m
    velocity_north: float | None = None  # m/s; None: the vehicle holds its position
    yaw: float = 0.0  # rad
    climb: float = 0.0  # m


STEPS = (
    Step("velocity 1 m/s", 1.0, 10.0, "m/s", velocity_north=1.0),
    Step("velocity 5 m/s", 5.0, 12.0, "m/s", velocity_north=5.0),
    Step("yaw 90°", math.pi / 2, 8.0, "rad", yaw=math.pi / 2),
    Step("altitude 2 m", 2.0, 12.0, "m", climb=2.0),
)


class Flight(CoreFlight):
    """One simulated vehicle in offboard mode at HEIGHT_M, over flat ground in still air."""

    def __init__(self, name: str, seed: int) -> None:
        """Boot, take off and settle. Raises RuntimeError when it does not fly."""
        pose = BootPose((0.0, 0.0, 0.0), 0.0)
        super().__init__(SimulatedVehicle(0, airframe.load(name), pose, seed=seed, origin=PX4_HOME), HEIGHT_M)
        self.setpoint = self._at()
        self.stream(self.setpoint)
        self.vehicle.autopilot.commander.set_mode("OFFBOARD")
        self.fly(10.0)
        self.check()

    def _at(self) -> CascadeSetpoint:
        position = self.vehicle.core.estimate["position_ned"]
        return CascadeSetpoint(position_ned=vec3(position), yaw=0.0)

    def fly(self, seconds: float) -> Array:
        """Fly; return a row per tick.

        Each row has the true north, east, down (m), velocity north (m/s), yaw (rad), and estimated north and east (m).
        """
        rows = np.empty((round(seconds / TICK_S), 7))
        truth = self.vehicle.plant.truth
        for tick in range(len(rows)):
            if tick % STREAM_TICKS == 0:
                self.stream(self.setpoint)
            self.vehicle.advance()
            rows[tick, :3], rows[tick, 3] = truth["position_ned"], truth["velocity_ned"][0]
            rows[tick, 4] = quat_yaw(tuple(truth["attitude"].tolist()))
            rows[tick, 5:] = self.vehicle.core.estimate["position_ned"][:2]
        return rows

    def step(self, step: Step) -> Array:
        """Fly a step; return the response at every tick, (n,), relative to the start, in the step's unit."""
        before, hold = self.fly(2.0), self.setpoint
        if step.velocity_north is not None:
            self.setpoint = hold._replace(
                position_ned=(NAN, NAN, hold.position_ned[2]), velocity_ned=(step.velocity_north, 0.0, NAN)
            )
        else:
            north, east, down = hold.position_ned
            self.setpoint = hold._replace(position_ned=(north, east, down - step.climb), yaw=step.yaw)
        rows = self.fly(step.seconds)
        if step.velocity_north is not None:
            answer = rows[:, 3]
            self.setpoint = hold._replace(position_ned=(NAN, NAN, hold.position_ned[2]), velocity_ned=(0.0, 0.0, NAN))
            self.fly(4.0)
            self.setpoint = self._at()
        elif step.climb:
            answer = before[:, 2].mean() - rows[:, 2]
            self.setpoint = hold
        else:
            answer = np.array([wrap_pi(yaw) for yaw in rows[:, 4] - before[:, 4].mean()])
            self.setpoint = hold
        self.fly(8.0)
        return np.asarray(answer)


def figures(step: Step, answer: Array) -> dict[str, float]:
    """Return rise_s, overshoot_percent and steady_error_percent of a response."""
    share = answer / step.size
    high = np.flatnonzero(share >= 0.9)
    rise = (high[0] - np.flatnonzero(share >= 0.1)[0]) * TICK_S if high.size else math.nan
    steady = share[-round(3.0 / TICK_S) :].mean()
    return {
        "rise_s": round(float(rise), 2),
        "overshoot_percent": round(max(float(share.max()) - 1.0, 0.0) * 100.0, 1),
        "steady_error_percent": round(abs(float(steady) - 1.0) * 100.0, 2),
    }


def measure(name: str, seeds: tuple[int, ...] = SEEDS) -> tuple[dict[str, Any], dict[str, Array]]:
    """Return the figures of an airframe, and the response to each step."""
    flights = [Flight(name, seed) for seed in seeds]
    answers = {step.name: np.asarray(np.mean([flight.step(step) for flight in flights], axis=0)) for step in STEPS}
    rows: dict[str, Any] = {step.name: figures(step, answers[step.name]) for step in STEPS}
    minutes = [flight.fly(60.0) for flight in flights]
    away = [float(np.hypot(*(m[:, :2] - m[0, :2]).T).max()) for m in minutes]
    lifted = [float(np.abs(m[:, 2] - m[0, 2]).max()) for m in minutes]
    # without the estimate's own error, which control cannot remove
    held = [
        float(np.hypot(*(m[:, 5:] - flight.setpoint.position_ned[:2]).T).max())
        for flight, m in zip(flights, minutes, strict=True)
    ]
    rows["hover"] = {
        "hold_error_m": round(float(np.median(held)), 3),
        "drift_m": round(float(np.median(away)), 3),
        "drift_most_m": round(max(away), 3),
        "drift_vertical_m": round(float(np.median(lifted)), 3),
    }
    return rows, answers


def misses(airframes: dict[str, dict[str, Any]]) -> list[str]:
    """Return a sentence for each figure beyond its goal."""
    sentences = []
    for name, rows in airframes.items():
        for step in STEPS:
            row = rows[step.name]
            if not row["overshoot_percent"] <= OVERSHOOT_MOST:
                sentences.append(f"{name}, {step.name}: overshoots by {row['overshoot_percent']} %")
            if not row["steady_error_percent"] <= STEADY_MOST:
                sentences.append(f"{name}, {step.name}: has a steady error of {row['steady_error_percent']} %")
        if not rows["hover"]["hold_error_m"] <= HOLD_MOST:
            sentences.append(f"{name}: is {rows['hover']['hold_error_m']} m from its setpoint while it hovers")
    return sentences


def table(airframes: dict[str, dict[str, Any]]) -> str:
    """Return the figures as Markdown."""
    heads = " | ".join(step.name for step in STEPS)
    lines = [f"| airframe | {heads} | hold error | drift in a minute |", "| --- |" + " --- |" * (len(STEPS) + 2)]
    for name, rows in airframes.items():
        cells = [
            f"{r['rise_s']:.2f} s · {r['overshoot_percent']:.1f} % · {r['steady_error_percent']:.2f} %"
            for r in (rows[step.name] for step in STEPS)
        ]
        hover = rows["hover"]
        lines.append(
            f"| {name} | {' | '.join(cells)} | {hover['hold_error_m']:.2f} m "
            f"| {hover['drift_m']:.2f} m ({hover['drift_most_m']:.2f} m) |"
        )
    return "\n".join(lines)


def draw(answers: dict[str, dict[str, Array]], folder: Path) -> Path:
    """Plot all responses into steps.png; return the path."""
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(12.0, 3.4), layout="constrained")
    for panel, step in zip(figure.subplots(1, len(STEPS)), STEPS, strict=True):
        for name, answer in answers.items():
            panel.plot(np.arange(len(answer[step.name])) * TICK_S, answer[step.name], label=name, linewidth=1.0)
        panel.axhline(step.size, color="black", linewidth=0.6)
        panel.axhline(step.size * (1.0 + OVERSHOOT_MOST / 100.0), color="black", linewidth=0.6, linestyle=":")
        panel.set(title=step.name, xlabel="s", ylabel=step.unit)
        panel.grid(visible=True, linewidth=0.3)
    figure.axes[0].legend(fontsize=8)
    path = folder / "steps.png"
    figure.savefig(path, dpi=110)
    return path


def main() -> None:
    parser = benchmark_parser(__doc__, short="fly one airframe once, to check that it runs")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw the step responses into this folder")
    parser.add_argument("--table", type=Path, metavar="FILE", help="write the table into this Markdown file")
    parser.add_argument("--airframe", action="append", choices=airframe.names(), help="only this airframe; repeatable")
    args = parser.parse_args()
    rows, answers = {}, {}
    names = args.airframe or airframe.names()
    seeds: tuple[int, ...] = SEEDS
    if args.short:
        names, seeds = names[:1], SEEDS[:1]
    for name in names:
        rows[name], answers[name] = measure(name, seeds)
    sentences = misses(rows)
    if args.plots:
        draw(answers, args.plots)
    if args.table:
        write(rows, args.table)
    print(
        json.dumps({"airframes": rows, "misses": sentences}) if args.json else "\n".join([table(rows), "", *sentences])
    )


BEGIN, END = "<!-- steps begin -->\n", "<!-- steps end -->"


def write(airframes: dict[str, dict[str, Any]], path: Path) -> None:
    """Put the table between BEGIN and END in a Markdown file. Raises ValueError if the file lacks them."""
    text = path.read_text(encoding="utf-8")
    head, tail = text.index(BEGIN) + len(BEGIN), text.index(END)
    path.write_text(text[:head] + table(airframes) + "\n" + text[tail:], encoding="utf-8")


if __name__ == "__main__":
    main()
