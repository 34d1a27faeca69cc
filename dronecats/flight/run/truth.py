"""Uses the drones' true poses in a flight: opens pilots that need them, and checks the start.

Before an episode begins, the autopilot's estimate and the start pose are compared with the truth. A wrong start pose or
estimate ends the flight with an infrastructure error, because the verdict would not measure the pilot.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from dronecats.flight.run.pilot import OpenPilot, commanded, opened
from dronecats.flight.sitl.episode_world import Placement, origin
from dronecats.flight.spec.disturbances import FrameFaults
from dronecats.flight.spec.flight import Flight
from dronecats.flight.stages.stage import TRUTH_HZ, Stage
from dronecats.pilots import roster
from dronecats.pilots.oracle import failing, oracle
from dronecats.pilots.oracle.noisy import NoisyPilot
from dronecats.pilots.oracle.oracle import TruthPilot
from dronecats.pilots.oracle.oracle_model import OracleModel
from episodes.world.world import World
from foundation.errors import InfrastructureError
from foundation.frames import Vec3, ned_to_geodetic, quat_from_euler, quat_to_euler, rotate_inverse, wrap_pi
from foundation.run_folder.rows import drone_label
from foundation.truth import KEPT, NewestTruth, TruthSample
from hil.link.link import Link
from hil.link.telemetry import VehicleState

LATE_S = 90.0  # s; the truth is kept for pictures up to this age


@contextmanager
def opened_in(world: World, flight: Flight, stage: Stage, folder: Path) -> Iterator[OpenPilot]:
    """Open the pilot of a flight whose true poses are known. Raises UsageError, InfrastructureError."""
    name = flight.spec.pilot
    if name is None or not roster.needs_truth(name) or flight.spec.replay:
        with opened(flight, stage, folder) as pilot:
            yield pilot
        return
    drain = stage.tap(lambda data: model.feed(data))
    model = OracleModel(
        world, flight.camera_model, origin(world), drain, name, _truth_pilot(name, flight),
        kept=_samples_to_keep(flight), obeys=not name.startswith(roster.FAILING), looks=name == roster.NOISY,
    )  # fmt: skip
    with commanded(flight, stage, folder, OpenPilot(model, begin=model.begin)) as pilot:
        yield pilot


def _truth_pilot(name: str, flight: Flight) -> TruthPilot:
    if name == roster.ORACLE:
        return oracle.reply_nearest
    if name == roster.NOISY:
        return NoisyPilot(flight.instruction, flight.seed)
    return failing.pilot(name.removeprefix(roster.FAILING))


def _samples_to_keep(flight: Flight) -> int:
    """Return the number of truth samples to keep: KEPT, plus the samples of LATE_S if pictures may be late."""
    return KEPT if flight.spec.disturbances.frame == FrameFaults() else KEPT + round(LATE_S * TRUTH_HZ)


HEADING_DEG, LEVEL_DEG, PLACE_M = 5.0, 3.0, 2.0  # limits of an estimate's errors before arming; PLACE_M is horizontal
START_M, START_DEG = 1.0, 5.0  # limits of a start pose's errors before the first question
DOWN = (0.0, 0.0, 1.0)


class TrueStart:
    """Compares estimates and start poses of a stage's drones with the truth. It sends nothing to the drones."""

    def __init__(self, stage: Stage, world: World, placement: Placement | None = None) -> None:
        """`placement` moves the autopilot's estimate onto the map; None: estimate and map have the same frame."""
        self._record, self._placement = world.record, placement or Placement(origin(world), (0.0, 0.0, 0.0), 0.0)
        self._truth = NewestTruth(origin(world))
        self._drain = stage.tap(self._truth.feed)

    def check_estimates(self, links: Sequence[Link]) -> None:
        """Compare the autopilots' estimates with the truth. Raises InfrastructureError."""
        for drone, link in enumerate(links):
            self._refuse(drone, estimate_faults(link.state, self._sample(drone), self._placement))

    def check_starts(self, links: Sequence[Link]) -> None:
        """Compare the drones' true poses with the starts of the record. Raises InfrastructureError."""
        for drone, start in enumerate(self._record.starts[: len(links)]):
            faults = start_faults(self._sample(drone), start.position_ned, math.radians(start.yaw_deg))
            self._refuse(drone, faults)

    def _sample(self, drone: int) -> TruthSample:
        self._drain()
        sample = self._truth.of(drone)
        if sample is None:
            raise InfrastructureError(f"no truth of {drone_label(drone)} arrives, so its start pose cannot be checked")
        return sample

    def _refuse(self, drone: int, faults: list[str]) -> None:
        if faults:
            label = f"{drone_label(drone)}: " if len(self._record.starts) > 1 else ""
            raise InfrastructureError(f"the episode does not begin: {label}{', '.join(faults)}. Fly it again")


def estimate_faults(state: VehicleState, true: TruthSample, placement: Placement) -> list[str]:
    """Return in words the large errors of an autopilot's estimate on the ground; empty if the drone may take off."""
    faults = []
    if state.euler is not None:
        roll, pitch, yaw = state.euler
        heading = math.degrees(abs(wrap_pi(yaw + placement.turn - quat_to_euler(true.attitude)[2])))
        believed = rotate_inverse(quat_from_euler(roll, pitch, yaw), DOWN)
        level = math.degrees(_angle(believed, rotate_inverse(true.attitude, DOWN)))
        faults += _fault_if_above("the autopilot's heading is", heading, HEADING_DEG, "°")
        faults += _fault_if_above("the autopilot's level is", level, LEVEL_DEG, "°")
    if state.position_ned is not None and state.origin is not None:
        place = placement.on_map(ned_to_geodetic(*state.origin, *state.position_ned))
        faults += _fault_if_above(
            "the autopilot's position is", math.dist(place[:2], true.position_ned[:2]), PLACE_M, " m"
        )
    return faults


def start_faults(true: TruthSample, position_ned: Vec3, yaw: float) -> list[str]:
    """Return in words the large errors of a drone's start pose; empty if the episode may begin."""
    away_m = math.dist(true.position_ned, position_ned)
    turned = math.degrees(abs(wrap_pi(quat_to_euler(true.attitude)[2] - yaw)))
    low_m = true.position_ned[2] - position_ned[2]
    where = f"{abs(low_m):.2f} m too {'low' if low_m > 0 else 'high'}, and in total"
    return [
        *_fault_if_above(f"the drone is {where}" if abs(low_m) > START_M else "the drone is", away_m, START_M, " m"),
        *_fault_if_above("the drone's nose is", turned, START_DEG, "°"),
    ]


def _fault_if_above(quantity: str, error: float, most: float, unit: str) -> list[str]:
    digits = 1 if unit == "°" else 2
    return [] if error <= most else [f"{quantity} {error:.{digits}f}{unit} off (at most {most:g}{unit})"]


def _angle(a: Vec3, b: Vec3) -> float:
    """Return the angle (rad) between two unit vectors."""
    return math.acos(max(-1.0, min(1.0, sum(x * y for x, y in zip(a, b, strict=True)))))
