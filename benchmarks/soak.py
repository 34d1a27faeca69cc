"""Flies hours of take-offs and landings with the vehicles of `dronecats sitl`: counts refused orders, memory and files.

    python -m benchmarks.soak [--json] [--hours H | --full] [--vehicles N …] [--speed N] [--short]

One client per vehicle connects on the open ground where `dronecats sitl` starts, and flies rounds: arm, take off, fly
10 m north and back, land on the vehicle's own place. Meanwhile another client requests a picture from the camera every
2 s of vehicle time. The first session has one vehicle, the second has four. Within a session no process is restarted
and no vehicle is reset.

    refused           orders that were not carried out, by reason
    without a cause   refused orders for which the autopilot sent no text
    memory %          largest change of a process's private memory from the first to the last third of the samples; the
                      first three rounds are left out, because caches fill in them
    files             lowest and highest number of open files of all processes together after the first three rounds;
                      every camera request and every log that is being written holds files open
    grown             change of the mean number of open files between the same thirds
    logs              largest number of logs in a vehicle's folder; SDLOG_DIRS_MAX keeps 10

By default a session lasts a quarter of an hour of vehicle time. With `--full`, the real benchmark, it lasts eight
hours, with `--short` one round.
"""

import argparse
import contextlib
import itertools
import json
import math
import statistics
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from benchmarks.machine import Machine, benchmark_parser
from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.sitl.config import CameraConfig, SimulatorConfig
from dronecats.flight.stages.stage import CAMERA, SIMULATOR
from episodes.records.catalogue import OPEN_GROUND
from foundation.errors import DronecatsError, LinkError
from foundation.frames import Vec3, ned_to_geodetic
from foundation.mavlink import dialect
from hil.cameras.http import HttpCamera
from hil.link.conversation import Conversation
from hil.link.link import Link
from hil.link.parameters import Parameters
from hil.link.telemetry import VehicleState
from hil.link.transport import connect

FULL_H, DEFAULT_H = 8.0, 0.25
VEHICLES = (1, 4)
SPEED = 10.0  # × real time
SHORT_ROUNDS = 1
WARM_ROUNDS = 3  # first rounds, whose samples are left out
HEIGHT_M, LAP_M = 4.0, 10.0
APART_M = 6.0  # m between landing places; the places at boot are too close together for landing
NEAR_M, SLOW_MPS = 0.8, 0.3  # m and m/s, tolerances of a reached place
PICTURE_S = 2.0  # s of vehicle time
KEPT = 10  # logs per vehicle
GIVEN_UP = 3  # consecutive failed rounds, after which a pilot gives up
LEAST_CHARGE = 0.5  # 0 … 1, lower bound of the battery charge, as in `dronecats sitl`


@dataclass
class Rounds:
    """The results of one vehicle's rounds."""

    count: int = 0
    failed: int = 0
    refusals: Counter[str] = field(default_factory=Counter)  # reason → number of refusals
    without_cause: int = 0
    hours: float = 0.0
    logs: int = 0  # largest number of logs in the vehicle's folder


class Pilot(threading.Thread):
    """Flies one vehicle."""

    def __init__(self, number: int, url: str, logs: Path, hours: float, rounds: int | None) -> None:
        """Fly for `hours` of vehicle time or, if given, `rounds` rounds."""
        super().__init__(daemon=True)
        self.rounds = Rounds()
        self.over = threading.Event()
        self.moved = threading.Event()  # whether the vehicle has left the place where it booted
        self.next: Pilot | None = None  # pilot of the vehicle that booted next to this one, to the east
        self._number, self._url, self._logs = number, url, logs
        self._hours, self._most = hours, rounds
        self.client = Conversation(connect(url), silence_s=60.0)
        self._place: Vec3 = (0.0, 0.0, 0.0)
        self._order_us = 0

    def run(self) -> None:
        try:
            self._prepare()
            begun_us, failed = self.client.time_us, 0
            while failed < GIVEN_UP and not self._is_done(begun_us):
                good = self._round()
                failed = 0 if good else failed + 1
                self.rounds.count += 1
                self.rounds.failed += not good
                self.rounds.hours = (self.client.time_us - begun_us) / 3.6e9
                self.rounds.logs = max(self.rounds.logs, len(list(self._logs.glob("*.ulg"))))
        except DronecatsError as fault:
            self.rounds.refusals[str(fault)] += 1
        finally:
            self.over.set()

    def _is_done(self, begun_us: int) -> bool:
        if self._most is not None:
            return self.rounds.count >= self._most
        return self.client.time_us - begun_us >= self._hours * 3.6e9

    def _prepare(self) -> None:
        """Limit the number of logs, and choose the landing place."""
        link = Link(connect(self._url))
        link.connect()
        Parameters(link).set("SDLOG_DIRS_MAX", KEPT)
        link.close()
        self.client.connect()
        self.client.wait_for(lambda state: state.healthy, 120.0, "becoming ready to arm")
        north, east, _ = self.client.state.position_ned or (0.0, 0.0, 0.0)
        self._place = (north, east + APART_M * self._number, -HEIGHT_M)

    def _round(self) -> bool:
        """Fly one round; return whether all orders were carried out."""
        try:
            self._order_us = self.client.time_us
            self.client.wait_for(lambda state: state.healthy, 60.0, "becoming ready to arm")
            self._order("arming", dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            self._order("take-off", dialect.MAV_CMD_NAV_TAKEOFF)
            self.client.wait_for(lambda s: s.mode == "HOLD" and s.landed is False, 60.0, "reaching take-off height")
            self._await_way()
            north, east, down = self._place
            for place in ((north, east, down), (north + LAP_M, east, down), (north, east, down)):
                self._go(place)
                self.moved.set()
            self._land()
        except LinkError as fault:
            self._note(str(fault))
            self._land()
            return False
        return True

    def _await_way(self) -> None:
        """Wait until the next vehicle has moved, because the way to the landing place leads over its boot place.

        On a busy machine, the next vehicle's pilot may be much slower.
        """
        while self.next is not None and not (self.next.moved.is_set() or self.next.over.is_set()):
            self.client.tick()

    def _order(self, name: str, command: int, *parameters: float) -> None:
        self._order_us = self.client.time_us
        self.client.order(name, command, *parameters, insist_s=5.0)

    def _go(self, place: Vec3) -> None:
        origin = self.client.state.origin
        if origin is None:
            raise LinkError("the autopilot sends no origin")
        lat, lon, alt = ned_to_geodetic(*origin, *place)
        self._order_us = self.client.time_us
        message = dialect.MAVLink_command_int_message(
            self.client.system, self.client.component, dialect.MAV_FRAME_GLOBAL, dialect.MAV_CMD_DO_REPOSITION, 0, 0,
            -1.0, 1.0, 0.0, math.nan, round(lat * 1e7), round(lon * 1e7), alt,
        )  # fmt: skip
        self.client.send(message)

        def is_there(state: VehicleState) -> bool:
            there, speed = state.position_ned, state.velocity_ned
            if there is None or speed is None:
                return False
            off = max(abs(a - b) for a, b in zip(there, place, strict=True))
            return off < NEAR_M and max(map(abs, speed)) < SLOW_MPS

        self.client.wait_for(is_there, 60.0, "flying to a place")

    def _land(self) -> None:
        if not self.client.state.armed:
            return
        try:
            self._order("landing", dialect.MAV_CMD_NAV_LAND)
            self.client.wait_for(lambda state: not state.armed, 90.0, "landing and disarming")
        except LinkError as fault:
            self._note(str(fault))

    def _note(self, fault: str) -> None:
        """Count a fault. It has no cause if the autopilot has sent no text since the order."""
        if not self.client.texts.since(self._order_us):
            self.rounds.without_cause += 1
        self.rounds.refusals[fault] += 1


class Photographer(threading.Thread):
    """Requests pictures of the drones in turn from the camera."""

    def __init__(self, url: str, pilots: list[Pilot]) -> None:
        super().__init__(daemon=True)
        self.pictures, self.failed = 0, 0
        self._pilots = pilots
        self._camera = HttpCamera(url, lambda: pilots[0].client.time_us)
        self._over = threading.Event()

    def run(self) -> None:
        due_us = 0
        while not self._over.wait(0.01):
            if self._pilots[0].client.time_us < due_us:
                continue
            due_us = self._pilots[0].client.time_us + round(PICTURE_S * 1e6)
            try:
                self._camera.newest(self.pictures % len(self._pilots))
                self.pictures += 1
            except DronecatsError:
                self.failed += 1

    def close(self) -> None:
        self._over.set()
        self.join()
        self._camera.close()


class Watch:
    """Samples the memory and the open files of this process and of its children."""

    def __init__(self) -> None:
        self.memory: dict[int, list[float]] = {}  # process → MB of private memory (USS), one value per sample
        self.files: list[int] = []  # number of open files of all processes together, one value per sample
        self.names: dict[int, str] = {}

    def sample(self) -> None:
        files = 0
        for process in (psutil.Process(), *psutil.Process().children(recursive=True)):
            with contextlib.suppress(psutil.Error):
                self.memory.setdefault(process.pid, []).append(process.memory_full_info().uss / 1e6)
                self.names[process.pid] = _name(process)
                files += process.num_fds()
        self.files.append(files)

    def figures(self) -> dict[str, Any]:
        """Return how memory and open files changed after the first rounds."""
        grown = {}
        for pid, values in self.memory.items():
            first, last = map(statistics.median, _thirds(values))
            grown[self.names[pid]] = {"mb": round(last, 1), "change_percent": round(100.0 * (last / first - 1.0), 1)}
        files = self.files[WARM_ROUNDS:] if len(self.files) > 2 * WARM_ROUNDS else self.files
        first, last = map(statistics.fmean, _thirds(self.files))
        return {
            "processes": grown,
            "memory_percent": max((change["change_percent"] for change in grown.values()), key=abs, default=0.0),
            "files_fewest": min(files, default=0),
            "files_most": max(files, default=0),
            "files_grown": round(last - first, 2),
        }


def _thirds(values: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
    """Return the first and the last third of the samples after the first rounds."""
    late = values[WARM_ROUNDS:] if len(values) > 2 * WARM_ROUNDS else values
    third = max(len(late) // 3, 1)
    return late[:third], late[-third:]


def _name(process: psutil.Process) -> str:
    """Return the name of a process of a flight: the last part of its module's name."""
    words = process.cmdline()
    return words[-1].partition(":")[0].rsplit(".", 1)[-1] if "dronecats.flight.processes.child" in words else "client"


@contextlib.contextmanager
def rig(vehicles: int, speed: float) -> Iterator[tuple[list[str], str, Path]]:
    """Start the processes; yield the vehicles' URLs, the camera's URL and the folder of the vehicles' states."""
    with (
        tempfile.TemporaryDirectory(prefix="dronecats-soak-") as folder,
        contextlib.closing(Supervisor(Path(folder))) as supervisor,
    ):
        config = SimulatorConfig(
            episode=OPEN_GROUND, speed=speed, count=vehicles, least_charge=LEAST_CHARGE, state_dir=folder
        )
        ports = supervisor.start(SIMULATOR, config).ready()
        truth = f"udpout://127.0.0.1:{ports['truth']}"
        camera = supervisor.start(CAMERA, CameraConfig(episode=OPEN_GROUND, truth=truth, count=vehicles))
        url = str(camera.ready()["url"])
        yield [f"udpout://127.0.0.1:{port}" for port in ports["agent"]], url, Path(folder)


def soak(vehicles: int, args: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of one session."""
    rounds = SHORT_ROUNDS if args.short else None
    with rig(vehicles, args.speed) as (urls, camera_url, folder):
        begun_s = time.monotonic()
        pilots = [Pilot(k, url, folder / f"vehicle-{k + 1}" / "log", args.hours, rounds) for k, url in enumerate(urls)]
        for pilot, neighbour in itertools.pairwise(pilots):
            pilot.next = neighbour
        for pilot in pilots:
            pilot.start()
        photographer, watch, seen = Photographer(camera_url, pilots), Watch(), 0
        photographer.start()
        while not all(pilot.over.wait(0.2) for pilot in pilots):
            if pilots[0].rounds.count > seen:
                seen = pilots[0].rounds.count
                watch.sample()
        photographer.close()
        watch.sample()
        by_vehicle = [pilot.rounds for pilot in pilots]
        hours = min(rounds.hours for rounds in by_vehicle)
        refusals: Counter[str] = sum((rounds.refusals for rounds in by_vehicle), Counter())
        return {
            "vehicles": vehicles,
            "hours": round(hours, 3),
            "rounds": sum(rounds.count for rounds in by_vehicle),
            "failed": sum(rounds.failed for rounds in by_vehicle),
            "refused": dict(refusals.most_common()),
            "without_cause": sum(rounds.without_cause for rounds in by_vehicle),
            "pictures": photographer.pictures,
            "pictures_failed": photographer.failed,
            **watch.figures(),
            "logs_most": max(rounds.logs for rounds in by_vehicle),
            "real_time_factor": round(3600.0 * hours / (time.monotonic() - begun_s), 1),
        }


def line(figures: dict[str, Any]) -> str:
    """Return the figures of a session as a row of the table."""
    return (
        f"{figures['vehicles']:8} {figures['hours']:6.2f} {figures['rounds']:6} {figures['failed']:6}"
        f" {sum(figures['refused'].values()):7} {figures['without_cause']:15} {figures['memory_percent']:8.1f}"
        f" {figures['files_fewest']:5}–{figures['files_most']:<5} {figures['files_grown']:5.1f}"
        f" {figures['logs_most']:4} {figures['pictures']:8}"
    )


def main() -> None:
    """Fly the sessions and print a line for each."""
    parser = benchmark_parser(__doc__, short="fly one round each, to check that it runs")
    parser.add_argument("--hours", type=float, default=DEFAULT_H, help=f"hours of vehicle time (default {DEFAULT_H:g})")
    parser.add_argument("--full", action="store_true", help=f"{FULL_H:g} hours")
    parser.add_argument(
        "--vehicles", type=int, nargs="+", default=VEHICLES, metavar="N", help="numbers of vehicles (default: 1 and 4)"
    )
    parser.add_argument("--speed", type=float, default=SPEED, help=f"factor on real time (default {SPEED:g})")
    args = parser.parse_args()
    args.hours = FULL_H if args.full else args.hours
    machine = Machine()
    if not args.json:
        print("vehicles  hours rounds failed refused without a cause memory %    files   grown logs pictures")
    for vehicles in args.vehicles:
        figures = soak(vehicles, args)
        if args.json:
            machine.look()
            print(json.dumps({**figures, "machine": machine.figures()}), flush=True)
            continue
        print(line(figures), flush=True)
        for reason, count in figures["refused"].items():
            print(f"         {count} × {reason}")


if __name__ == "__main__":
    main()
