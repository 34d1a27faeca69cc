"""Measures how long the making of a film takes: `python -m benchmarks.film --json`.

The oracle flies an episode in lockstep without pictures. The flight is then filmed as by `dronecats film`. Processor
times include all processes, their start and the encoder. `shared_out_s` is the processor time divided by `jobs`: the
expected wall time on an idle machine.
"""

import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2

from benchmarks.machine import Machine, benchmark_parser, print_figures, total_cpu_s
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.view.film.film import make
from dronecats.view.film.plan import filmable, plan

EPISODE = "campus-tracking-01"
SIZE, FPS = (1280, 720), 30
SHORT_SIZE, SHORT_FPS = (320, 180), 10


def filmed(folder: Path, size: tuple[int, int], fps: int, seconds: float, jobs: int) -> dict[str, Any]:
    """Film the first `seconds` of a flight. Return the cost, and the length as read back from the file."""
    film_plan = plan(filmable(folder), size=size, fps=fps, speed=1.0, from_s=0.0, to_s=seconds, drone=None)
    film_plan = replace(film_plan, closing=0)
    film = folder.parent / "film.mp4"
    began, before = time.monotonic(), total_cpu_s()
    codec = make(film_plan, film, jobs)
    wall, cpu = time.monotonic() - began, total_cpu_s() - before
    reader = cv2.VideoCapture(str(film))
    read = int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
    return {"pictures": film_plan.pictures, "read_back": read, "film_s": round(read / reader.get(cv2.CAP_PROP_FPS), 2),
            "wall_s": round(wall, 1), "cpu_s": round(cpu, 1), "megabytes": round(film.stat().st_size / 1e6, 2),
            "codec": codec}  # fmt: skip


def figures(scratch: Path, size: tuple[int, int], fps: int, seconds: float, jobs: int) -> dict[str, Any]:
    """Return the cost of a film, in total and per picture."""
    machine = Machine()
    flight = FlightSpec(
        pilot="oracle", episode=EPISODE, simulated=Simulated(speed=None, rendered=False), seconds=seconds, full=True
    )
    fly(flight, scratch / "run", lambda words: None)
    folder = scratch / "run" / EPISODE
    cost = filmed(folder, size, fps, seconds, jobs)
    machine.look()
    per_picture = 1e3 * cost["cpu_s"] / cost["pictures"]
    return {
        "machine": machine.figures(),
        "size": f"{size[0]}x{size[1]}",
        "jobs": jobs,
        **cost,
        "shared_out_s": round(cost["cpu_s"] / jobs, 1),
        "cpu_ms_per_picture": round(per_picture, 1),
        "cpu_per_picture_per_loop": machine.per_loop(per_picture),
    }


def main() -> None:
    """Print the figures."""
    parser = benchmark_parser(__doc__, short="make a small film of one second, to check that it works")
    parser.add_argument("--seconds", type=float, default=60.0, metavar="S", help="length of the film (default 60)")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), metavar="N", help="processes (2)")
    args = parser.parse_args()
    size, fps, seconds = (SHORT_SIZE, SHORT_FPS, 1.0) if args.short else (SIZE, FPS, args.seconds)
    with tempfile.TemporaryDirectory() as scratch:
        measured = figures(Path(scratch), size, fps, seconds, 1 if args.short else args.jobs)
    print_figures(measured, args.json)


if __name__ == "__main__":
    main()
