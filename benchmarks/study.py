"""Measures how many episodes an hour a study flies, the gain of a second job, and where the time goes.

    python -m benchmarks.study [--json] [--suite NAME] [--drawn NAME] [--short]

Three benchmarks are timed from the start of the command to its end:

    undrawn   `dronecats bench --pilot noisy --flights 2`, which renders no pictures: the eighty episodes of one drone,
              with one job and with two
    fleets    the same command for the twenty episodes of four drones, with two jobs
    drawn     the twelve episodes of `quick` with the pilot vision, which needs every frame, with two jobs

`episodes_per_core_hour` counts the processor time of all processes, including their start. It is also meaningful on a
busy machine. `episodes_per_hour`, `minutes_for_2000` (2000 episodes of one drone), `minutes_for_2000_of_all` (one in
five has four drones) and `two_jobs_over_one` count wall time and need an idle machine. For `parts` and `phases`, one
process flies undrawn episodes one after another. After the start of the process, a sample every 2 ms of processor time
notes the innermost running function of the project (`parts`) and the phase of the flight (`phases`).
"""

import signal
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.bench import run_bench
from benchmarks.machine import Machine, benchmark_parser, print_figures
from dronecats.bench import worker
from dronecats.cli.exit_status import exit_status
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_json
from dronecats.pilots.vision import ocr
from episodes.records import catalogue

ROOT = Path(__file__).parent.parent
SAMPLE_PERIOD_S = 0.002  # s of processor time between samples
PROFILED = 12  # number of episodes, evenly spread over the suite
WORK = {  # folder or file → kind of work of its code; the first match counts
    "dronecats/flight/sitl/fused.py": "physics, estimator and inner loops (compiled)",
    "foundation/wire.py": "MAVLink packed and parsed",
    "foundation/mavlink.py": "MAVLink packed and parsed",
    "foundation/truth.py": "truth bus",
    "dronecats/flight/sitl": "simulation around the kernel",
    "vehicles": "simulation around the kernel",
    "autopilot": "commander and telemetry",
    "hil": "link",
    "episodes": "world and visibility",
    "dronecats/flight/logger": "logs",
    "foundation/run_folder": "logs",
    "dronecats/agent": "agent and pilot",
    "dronecats/pilots": "agent and pilot",
    "dronecats/judge": "verdict",
}
PHASES = {  # function of dronecats/flight/run → phase of the flight
    "ascend": "ascent to the start pose",
    "finish": "landing",
    "fly_and_judge": "making ready, verdict",
}
GOALS = {
    "minutes_for_2000": "≤ 25 (two idle cores)",
    "drawn.episodes_per_hour": "≥ 250 (two idle cores)",
    "two_jobs_over_one": "≥ 1.85",
}


class Sampler:
    """Counts the kind of work in progress and the phase of the flight, at fixed intervals of processor time."""

    def __init__(self) -> None:
        self.work: Counter[str] = Counter()
        self.phases: Counter[str] = Counter()

    def look(self, number: int, frame: FrameType | None) -> None:
        """Count one sample: the kind of work of the innermost function of the project, and the phase."""
        part = phase = None
        while frame is not None:
            place = _place(frame.f_code.co_filename)
            part = part or (part_of(place) if place else None)
            if place.startswith("dronecats/agent/loop.py"):
                phase = phase or "episode"
            elif place.startswith("dronecats/flight/run/"):
                phase = phase or PHASES.get(frame.f_code.co_name)
            frame = frame.f_back
        self.work[part or "else"] += 1
        self.phases[phase or PHASES["fly_and_judge"]] += 1

    @contextmanager
    def sampling(self) -> Iterator[None]:
        """Sample every SAMPLE_PERIOD_S of this process's processor time in a `with` block."""
        before = signal.signal(signal.SIGPROF, self.look)
        signal.setitimer(signal.ITIMER_PROF, SAMPLE_PERIOD_S, SAMPLE_PERIOD_S)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)


def part_of(place: str) -> str:
    """Return the kind of work that a file of the project does, by its path in the repository."""
    return next((name for folder, name in WORK.items() if place.startswith(folder)), "else")


def _place(file: str) -> str:
    """Return a file's path in the repository; empty for a file outside the project."""
    path = Path(file)
    return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) and "site-packages" not in file else ""


def profiled(episodes: Sequence[str], folder: Path) -> Sampler:
    """Fly each episode once to fill the caches, and once with the sampler."""
    worker.compile_all()
    sampler = Sampler()
    for turn in ("first", "looked at"):
        for episode in episodes:
            spec = FlightSpec(episode=episode, pilot="noisy", simulated=Simulated(speed=None, rendered=False))
            into = folder / turn / episode
            (into / "frames").mkdir(parents=True)
            if turn == "first":
                worker.fly_flight(as_json(spec), into)
                continue
            with sampler.sampling():
                worker.fly_flight(as_json(spec), into)
    return sampler


def shares(counted: Counter[str]) -> dict[str, float]:
    """Return the share of each name in the total, the largest first."""
    total = counted.total() or 1
    return {name: round(count / total, 3) for name, count in counted.most_common()}


def bench_figures(words: list[str], jobs: int) -> dict[str, Any]:
    """Return the figures of one `dronecats bench`."""
    with tempfile.TemporaryDirectory() as folder:
        summary, wall_s, cpu_s = run_bench(Path(folder) / "bench", [*words, "--jobs", str(jobs)])
    done = summary["done"]
    return {
        "jobs": jobs,
        "episodes": done,
        "solved": sum(row["solved"] for row in summary["rows"] if row["group"] == "all"),
        "wall_s": round(wall_s, 1),
        "cpu_s_per_episode": round(cpu_s / done, 2),
        "episodes_per_core_hour": round(3600.0 * done / cpu_s),
        "episodes_per_hour": round(3600.0 * done / wall_s),
    }


def minutes(episodes: int, measured: dict[str, Any]) -> float:
    """Return the wall minutes of `episodes` episodes at the measured pace."""
    return float(episodes * measured["wall_s"] / measured["episodes"] / 60.0)


def main() -> int:
    """Print the figures; return the exit status."""
    parser = benchmark_parser(__doc__, short="quick check that every figure can be measured")
    parser.add_argument("--suite", default="one-drone", metavar="NAME", help="suite to fly without rendering")
    parser.add_argument(
        "--drawn", default="quick", metavar="NAME", help="suite to fly with the pilot vision (default quick)"
    )
    args = parser.parse_args()
    ocr.check_installed()
    machine, few = Machine(), ["--limit", "2"] if args.short else []
    undrawn = ["--pilot", "noisy", *(few or ["--flights", "2"])]
    one_job, two_jobs = (bench_figures(["--suite", args.suite, *undrawn], jobs) for jobs in (1, 2))
    fleets = bench_figures(["--suite", "commanding", *undrawn], 2)
    drawn = bench_figures(["--suite", args.drawn, "--pilot", "vision", *few], 2)
    names = catalogue.suite_ids(args.suite)
    chosen = names[:1] if args.short else names[:: max(1, len(names) // PROFILED)]
    with tempfile.TemporaryDirectory() as folder:
        sampler = profiled(chosen, Path(folder))
    machine.look()
    figures = {
        "undrawn": {"one": one_job, "two": two_jobs},
        "fleets": fleets,
        "minutes_for_2000": round(minutes(2000, two_jobs), 1),
        "minutes_for_2000_of_all": round(minutes(1600, two_jobs) + minutes(400, fleets), 1),
        "two_jobs_over_one": round(one_job["wall_s"] / two_jobs["wall_s"], 2),
        "drawn": drawn,
        "parts": shares(sampler.work),
        "phases": shares(sampler.phases),
        "goals": GOALS,
        "machine": machine.figures(),
    }
    print_figures(figures, args.json)
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_status("benchmarks.study", main))
