"""Measures the delay, the update rate and the cost of the live page: `python -m benchmarks.view --json`.

`dronecats fly --view` flies an episode in real time. A client connects to the page as a browser does, and notes when
each true attitude arrives. The delay of a sample is this arrival (wall time) minus its vehicle time minus the offset
between the two clocks. The offset is the smallest difference, over all samples, between the wall time at which a sample
appears in flight.tlog and its vehicle time. So the delay includes the waits in viewer and socket. Of the waits in
logger and file, it includes only the excess over their smallest value. It does not include drawing in the browser: one
frame (17 ms) with a graphics card. `flush_ratio` is the median processor time of lockstep flights whose logger flushes
every delivery, divided by the median of flights whose logger does not flush. The two kinds of flights alternate.
"""

import math
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.machine import Machine, benchmark_parser, print_figures, process_cpu_s
from dronecats.cli.exit_status import exit_status
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.view.live.folder import FrameTail, load_world
from dronecats.view.live.wire_state import WireState
from dronecats.view.scene import display
from foundation import extras
from foundation.run_folder import layout
from foundation.run_folder.writing import TelemetryLog

EPISODE = "residential-approaching-03"
NODE = "/world/flight/drone-0"
GOALS = {"late_ms_p95": "<= 150", "updates_hz": ">= 15", "viewer_core": "<= 0.10"}
READY_S = 300.0
DIGITS = 9  # decimals to which quaternions are rounded; a sample is recognised by its quaternion


class Arrivals(threading.Thread):
    """Notes when each attitude of the drone arrives at a page's client: quaternion → wall s."""

    def __init__(self, url: str) -> None:
        from benchmarks.page_client import PageClient

        super().__init__(daemon=True)
        self._client = PageClient(url)
        self.at: dict[tuple[float, ...], float] = {}
        self.done = threading.Event()

    def run(self) -> None:
        while not self.done.is_set():
            for message in self._client.receive(0.2):
                if message["type"] == "SetOrientationMessage" and message["name"] == NODE:
                    self.at.setdefault(_key(message["wxyz"]), time.monotonic())
        self._client.close()


class Written(threading.Thread):
    """Notes when each true pose appears in flight.tlog: rows of quaternion (browser's axes), vehicle s, wall s."""

    def __init__(self, folder: Path) -> None:
        super().__init__(daemon=True)
        self._folder = folder
        self.samples: list[tuple[tuple[float, ...], float, float]] = []
        self.done = threading.Event()

    def run(self) -> None:
        while not (self._folder / layout.TLOG).exists():
            if self.done.wait(0.05):
                return
        world = load_world(self._folder)
        assert world is not None
        scene, tail = world.scene, FrameTail(self._folder / layout.TLOG)
        flight = WireState((scene.latitude_deg, scene.longitude_deg, scene.altitude_m))
        while not self.done.wait(0.002):
            for frame in tail.read():
                before = flight.time_us
                flight.feed([frame])
                pose = flight.pose(0)
                if pose is not None and pose.true and flight.time_us > before:
                    turned = _key(display.wxyz_of(pose.attitude))
                    self.samples.append((turned, pose.time_us / 1e6, time.monotonic()))


def _keep_back(log: TelemetryLog) -> None:
    """Do nothing, in place of `TelemetryLog.flush`."""


def _key(quaternion: Any) -> tuple[float, ...]:
    return tuple(round(float(value), DIGITS) for value in quaternion)


def viewer_of(pid: int) -> int:
    """Return the id of the process that serves the page of a command. Raises ProcessLookupError if none."""
    for child in psutil.Process(pid).children():
        with suppress(psutil.Error):  # it has just ended
            if "viewer_process" in " ".join(child.cmdline()):
                return int(child.pid)
    raise ProcessLookupError(f"no child of process {pid} serves a page")


def flush_ratio(scratch: Path, flights: int, seconds: float) -> float:
    """Return the median processor time of flights with `TelemetryLog.flush`, divided by the median without."""
    spec = FlightSpec(
        pilot="oracle", episode=EPISODE, simulated=Simulated(speed=None, rendered=False), seconds=seconds, full=True
    )
    flush, used = TelemetryLog.flush, {True: list[float](), False: list[float]()}
    for flight in range(-1 if flights > 1 else 0, flights):  # flight -1 loads the compiled code
        for handed_on in (True, False):
            setattr(TelemetryLog, "flush", flush if handed_on else _keep_back)  # noqa: B010 - replaces a method
            began_s = time.process_time()
            try:
                fly(spec, scratch / f"lockstep-{flight}-{handed_on}", lambda line: None)
            finally:
                setattr(TelemetryLog, "flush", flush)  # noqa: B010
            if flight >= 0:
                used[handed_on].append(time.process_time() - began_s)
    return round(statistics.median(used[True]) / statistics.median(used[False]), 3)


def figures(scratch: Path, seconds: float) -> dict[str, Any]:
    """Fly, and return the figures of `seconds` of the flight."""
    machine, run = Machine(), scratch / "run"
    words = ["fly", "--sitl", "--pilot", "oracle", "--full", "--episode", EPISODE, "--out", str(run)]
    command = subprocess.Popen(
        [sys.executable, "-m", "dronecats.cli.main", *words, "--view"], stdout=subprocess.PIPE, text=True
    )
    written = Written(run / EPISODE)
    try:
        assert command.stdout
        url = next(found[0] for line in command.stdout if (found := re.search(r"http://127\.0\.0\.1:\S+", line)))
        threading.Thread(target=command.stdout.read, daemon=True).start()
        arrivals = Arrivals(url)
        arrivals.start()
        written.start()
        due_s = time.monotonic() + READY_S
        while not (run / EPISODE / layout.DECISIONS).exists() or not (run / EPISODE / layout.DECISIONS).read_bytes():
            assert time.monotonic() < due_s, "the flight does not begin"
            time.sleep(0.2)
        viewer = viewer_of(command.pid)
        began_s, before_s = time.monotonic(), process_cpu_s(viewer)
        time.sleep(seconds)
        used_s, wall_s = process_cpu_s(viewer) - before_s, time.monotonic() - began_s
        for thread in (arrivals, written):
            thread.done.set()
            thread.join()
    finally:
        command.terminate()
        command.wait(60.0)
    machine.look()
    samples = [sample for sample in written.samples if began_s - 5.0 < sample[2] < began_s + wall_s]
    least_s = min(wall - vehicle for _, vehicle, wall in samples)
    late = [arrivals.at[key] - vehicle - least_s for key, vehicle, _ in samples if key in arrivals.at]
    shown = sorted(at for at in arrivals.at.values() if began_s <= at <= began_s + wall_s)
    core = used_s / wall_s
    return {
        "machine": machine.figures(),
        "seconds": round(wall_s, 1),
        "samples": len(samples),
        "matched": len(late),
        "late_ms_median": round(1e3 * float(np.median(late)), 1),
        "late_ms_p95": round(1e3 * float(np.percentile(late, 95)), 1),
        "updates_hz": round(len(shown) / wall_s, 1),
        "gap_ms_p99": round(1e3 * float(np.percentile(np.diff(shown), 99)), 1),
        "viewer_core": round(core, 3),
        "viewer_core_per_loop": machine.per_loop(1e3 * core),
        "goals": GOALS,
    }


def main() -> int:
    """Print the figures; return the exit status."""
    parser = benchmark_parser(__doc__, short="fly a few seconds, to check that every figure can be measured")
    parser.add_argument("--seconds", type=float, default=60.0, metavar="S", help="length of the flight (default 60)")
    args = parser.parse_args()
    extras.require("viser")
    with tempfile.TemporaryDirectory(prefix="dronecats-view-") as scratch:
        measured = figures(Path(scratch), 5.0 if args.short else args.seconds)
        flights = (1, 3.0) if args.short else (7, 60.0)
        measured["flush_ratio"] = flush_ratio(Path(scratch), *flights)
    print_figures(measured, args.json)
    return 0 if math.isfinite(measured["late_ms_median"]) else 1


if __name__ == "__main__":
    sys.exit(exit_status("benchmarks.view", main))
