"""The oracle with the vision pilot's errors: a pilot for studies of thousands of flights without pictures.

The noisy pilot knows the truth and imitates the vision pilot. It flies to the target (with an error in pixel and
depth), flies to something else, or searches. It does each as often as vision does (`vision_errors.json`). It never
finds a target that the picture does not show. Like vision, it declares when its estimated distance is small. Its random
draws depend only on the record's seed, the flight's seed, the drone and the step. Flights under different disturbances
therefore have the same draws and can be compared in pairs. In studies the noisy pilot represents vision, not a model.

The probabilities at a step depend on the previous step and, for a visible target, on the target's distance. There are
two sets of values: from flights in which vision failed, and from flights in which vision succeeded. One draw per flight
selects the set, because a mistake of vision lasts the whole flight. `python -m dronecats.pilots.fitting vision-errors`
fits the values.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from dronecats.pilots import actions
from dronecats.pilots.oracle import oracle
from dronecats.pilots.oracle.oracle import TrueState
from dronecats.pilots.vision import search
from dronecats.pilots.vision.command import read_inscription, read_place_expression, read_referent
from foundation.camera import camera_pose
from foundation.conversion import decode
from foundation.frames import Vec3, rotate
from foundation.protocol import FINISHED, POINT_SPAN

NamedBy = Literal["paint", "place", "inscription"]  # how a command names its target
BANDS_M = (8.0, 16.0)  # m, the edges between the three bands of distance: near, middle, far
FILE = Path(__file__).with_name("vision_errors.json")
ARRIVED_M = 4.6  # m, estimated distance at which the pilot declares, as in `vision.color_target`
_WANDERS = 3  # after this many strides to other vantage points, a new search circle begins
_LEAVE_DEG = 75.0  # deg, turn away after a wrong declaration
_EDGE = 60.0  # least distance of a point from the picture's sides, which are at 0 and 1000


def distance_band(distance_m: float) -> int:
    """Return the band of a distance: 0 near, 1 middle, 2 far."""
    return sum(distance_m >= edge for edge in BANDS_M)


@dataclass(frozen=True, slots=True, kw_only=True)
class Attention:
    """Shares of the steps at which vision takes a thing (treats it as the target).

    `strays`, `stays` and `claims` count only steps at which vision does not take the target.
    """

    found: tuple[float, float, float]  # per band: takes the visible target, but did not take it at the step before
    kept: tuple[float, float, float]  # per band: takes the visible target, and took it at the step before
    strays: float  # takes something else or declares wrongly; the step before did not take something else
    stays: float  # takes something else; the step before did too
    claims: float  # declares wrongly; the step before took something else


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionErrors:
    """The errors for one way of naming the target."""

    flights: int  # number of flights in the fit
    mistaken: float  # share of flights that failed
    sure: Attention  # attention in flights that succeeded
    lost: Attention  # attention in flights that failed
    aside_px: float  # px of a picture 1280 wide: standard deviation of a point's horizontal error
    above_px: float  # px of a picture 1280 wide: standard deviation of a point's vertical error
    depth: float  # median log ratio: log(depth of the `go` / true depth of the target's centre)
    depth_flight: float  # standard deviation of the flights' mean log ratios
    depth_step: float  # standard deviation of the log ratio between the steps of a flight
    astray_m: float  # m, median depth of a `go` at something else
    astray: float  # standard deviation of the log of the depth of a `go` at something else


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionErrors:
    """The errors of vision, and the run that they were fitted to."""

    fitted_to: str  # the run folder's name
    code_sha256: str  # SHA-256 of the code of that run
    eyes: dict[NamedBy, DetectionErrors]


@cache
def shipped_errors() -> VisionErrors:
    return decode(FILE.read_bytes(), VisionErrors)


def named_by(command: str) -> NamedBy:
    """Return how a command names its target. The order of the tests is the same as in vision."""
    if read_inscription(command) is not None:
        return "inscription"
    by_place = read_referent(command).color is None and read_place_expression(command) is not None
    return "place" if by_place else "paint"


@dataclass(slots=True)
class _Memory:
    """The memory of one drone's pilot."""

    on_target: bool = False  # the pilot took the target at the previous step
    astray_ned: Vec3 | None = None  # m, the place of something else that the pilot takes for the target
    declared: bool = False  # the pilot declared at the previous step
    nearer: bool = False  # the drone has flown one stride nearer after a wrong declaration
    side: float = 1.0  # direction of search turns: 1 right, -1 left
    turns: int = 0  # turns of the current circle
    strides: int = 0  # strides to another vantage point after the circle


@dataclass(frozen=True, slots=True)
class _Draw:
    """The random numbers of one step of one drone. All are drawn at every step, whether used or not."""

    takes: float  # uniform, 0 … 1, like the next two
    strays: float
    where: float
    aside: float  # standard normal, like the next three
    above: float
    depth: float
    astray: float


@dataclass(slots=True)
class NoisyPilot:
    """The noisy pilot for one flight: a `TruthPilot`."""

    instruction: str
    seed: tuple[int, ...]  # (seed of the record, seed of the flight)
    errors: VisionErrors = field(default_factory=shipped_errors)
    _memories: dict[int, _Memory] = field(default_factory=dict)

    def __call__(self, states: Sequence[TrueState]) -> str:
        """Return the reply for the drones of a request. The drone nearest to the target flies; the others hover."""
        nearest = min(states, key=lambda state: state.distance_m)
        return actions.join([self._decide(state) if state is nearest else actions.think() for state in states])

    @property
    def _errors(self) -> DetectionErrors:
        return self.errors.eyes[named_by(self.instruction)]

    def _decide(self, state: TrueState) -> str:
        errors, memory = self._errors, self._memories.setdefault(state.drone, _Memory())
        mistaken, flight_depth = self._draw_flight(errors)
        draw, attention = self._draw(state), errors.lost if mistaken else errors.sure
        has_declared, memory.declared = memory.declared, False
        shares = attention.kept if memory.on_target else attention.found
        if state.visible and draw.takes < shares[distance_band(state.distance_m)]:
            memory.on_target, memory.astray_ned = True, None
            return self._to_target(state, memory, self._estimate_ned(state, errors, draw, flight_depth), has_declared)
        memory.on_target, memory.nearer = False, False
        if has_declared:
            memory.astray_ned, memory.turns, memory.strides = None, 0, 0
            return actions.rotate(math.copysign(_LEAVE_DEG, memory.side))
        return self._without_target(state, memory, attention, errors, draw)

    def _to_target(self, state: TrueState, memory: _Memory, estimate_ned: Vec3, has_declared: bool) -> str:
        """Return a `go` to the estimated target; on arrival a declaration, or a stride nearer after a wrong one."""
        memory.turns, memory.strides = 0, 0
        memory.side = math.copysign(1.0, state.bearing_deg)
        if math.dist(state.position_ned, estimate_ned) > ARRIVED_M:
            reply = _fly_to(state, estimate_ned)
            memory.declared = _declares(reply)
            return reply
        if has_declared and not memory.nearer:
            memory.nearer = True
            x, _ = oracle.pixel(oracle.in_camera(state, estimate_ned), state.camera)
            return actions.go(POINT_SPAN * x / state.camera.width, POINT_SPAN * 0.5, actions.SHORTEST_DEPTH_M)
        memory.declared, memory.nearer = True, False
        return actions.finished()

    def _without_target(
        self, state: TrueState, memory: _Memory, attention: Attention, errors: DetectionErrors, draw: _Draw
    ) -> str:
        """Return the action if the pilot does not take the target: fly to something else, declare there, or search."""
        if memory.astray_ned is None:
            if draw.strays < attention.strays:
                memory.astray_ned = self._astray_ned(state, errors, draw)
        elif draw.strays < attention.claims:
            memory.declared = True
            return actions.finished()
        elif draw.strays >= attention.claims + attention.stays:
            memory.astray_ned = None
        if memory.astray_ned is not None:
            reply = _fly_to(state, memory.astray_ned)
            if not _declares(reply):
                memory.turns, memory.strides = 0, 0
                return reply
            memory.astray_ned = None  # on arrival the pilot sees that this is not the target
        return self._search(memory, draw)

    def _search(self, memory: _Memory, draw: _Draw) -> str:
        """Return the next search action: turns until the circle is closed, then strides to another vantage point."""
        if memory.turns < search.CIRCLE_TURNS:
            memory.turns += 1
            return actions.rotate(math.copysign(search.SWEEP_DEG, memory.side))
        memory.strides += 1
        if memory.strides >= _WANDERS:
            memory.turns, memory.strides = 0, 0
        u = _EDGE + draw.where * (POINT_SPAN - 2.0 * _EDGE) if memory.strides == 1 else 0.5 * POINT_SPAN
        return actions.go(u, 0.5 * POINT_SPAN, search.WANDER_M)

    def _estimate_ned(self, state: TrueState, errors: DetectionErrors, draw: _Draw, flight_depth: float) -> Vec3:
        """Return the estimated place (m, NED) of the target, with errors in pixel and depth."""
        camera, true = state.camera, oracle.in_camera(state, state.target_ned)
        x, y = oracle.pixel(true, camera)
        x = min(max(x + errors.aside_px * draw.aside, 0.0), camera.width)
        y = min(max(y + errors.above_px * draw.above, 0.0), camera.height)
        factor = math.exp(errors.depth + errors.depth_flight * flight_depth + errors.depth_step * draw.depth)
        return _place(state, x, y, true[0] * factor)

    def _astray_ned(self, state: TrueState, errors: DetectionErrors, draw: _Draw) -> Vec3:
        """Return a random place (m, NED) for something else, on the middle row of the picture."""
        u = _EDGE + draw.where * (POINT_SPAN - 2.0 * _EDGE)
        depth = errors.astray_m * math.exp(errors.astray * draw.astray)
        return _place(state, u * state.camera.width / POINT_SPAN, 0.5 * state.camera.height, depth)

    def _draw_flight(self, errors: DetectionErrors) -> tuple[bool, float]:
        """Return whether this flight uses `errors.lost`, and its mean depth error in units of `depth_flight`."""
        rng = np.random.default_rng((*self.seed, 0))
        return bool(rng.random() < errors.mistaken), float(rng.standard_normal())

    def _draw(self, state: TrueState) -> _Draw:
        rng = np.random.default_rng((*self.seed, 1 + state.step, 1 + state.drone))
        return _Draw(*rng.random(3).tolist(), *rng.standard_normal(4).tolist())


def _fly_to(state: TrueState, point_ned: Vec3) -> str:
    return oracle.next_action(replace(state, target_ned=point_ned, target_velocity_ned=(0.0, 0.0, 0.0)))


def _declares(reply: str) -> bool:
    return bool(json.loads(reply)["action"] == FINISHED)


def _place(state: TrueState, x: float, y: float, depth_m: float) -> Vec3:
    """Return the place (m, NED) at a pixel and a depth."""
    camera = state.camera
    right = depth_m * (x - camera.width / 2.0) / camera.focal_px
    below = depth_m * (y - camera.height / 2.0) / camera.focal_px
    pose = camera_pose(state.position_ned, state.attitude, camera)
    north, east, down = rotate(pose.attitude, (depth_m, right, below))
    return (pose.position_ned[0] + north, pose.position_ned[1] + east, pose.position_ned[2] + down)
