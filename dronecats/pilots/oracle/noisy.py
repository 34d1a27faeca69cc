"""The oracle with the vision pilot's errors: a pilot for studies that need thousands of flights and no picture drawn.

It is told the truth, and says of it what vision would have made of a picture (`vision_errors`): the target at a wrong
pixel and a wrong depth, something else in its stead, or nothing, as often as vision did; never a target that the
picture does not show. It declares, as vision does, by the distance that it judges. What it errs by is drawn of the
record's seed, the flight's, the drone and the step, and of nothing else: the same question meets the same draw, so
that flights under different disturbances can be compared in pairs. It stands for vision in studies and for no model.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dronecats.pilots import reply
from dronecats.pilots.oracle import oracle
from dronecats.pilots.oracle.sight import TrueSight
from dronecats.pilots.oracle.vision_errors import Attention, EyeErrors, Telling, VisionErrors, band, shipped
from dronecats.pilots.vision import expression, inscription, referent, search
from foundation.frames import Vec3, rotate
from foundation.protocol import FINISHED, NEAR_SCALE, POINT_SPAN, STRIDE_MIN_M

ARRIVED_M = 4.6  # of the distance that it judges, at which it declares, as vision does
_CIRCLE = 5  # turns that show everything around
_WANDERS = 3  # strides to another place to look from
_LEAVE_DEG = 75.0  # turned away from what was declared in vain
_SHORTEST_M = STRIDE_MIN_M / NEAR_SCALE + 0.01  # depth of the shortest stride
_EDGE = 60.0  # 0–1000, a point this near to the picture's side is none that it flies to


def eye_of(command: str) -> Telling:
    """Return what a command tells its target by, in the order in which vision reads it."""
    if inscription.named(command) is not None:
        return "inscription"
    by_place = referent.read(command).color is None and expression.read(command) is not None
    return "place" if by_place else "paint"


@dataclass(slots=True)
class _Mind:
    """What one drone's pilot goes by besides the truth of now."""

    on_target: bool = False  # the target was taken for itself at the step before
    astray_ned: Vec3 | None = None  # m, what else was taken for it
    declared: bool = False  # the step before declared
    nearer: bool = False  # after a declaration in vain it has come nearer once
    side: float = 1.0  # to which it turns
    turns: int = 0  # of the circle so far
    strides: int = 0  # of the walk that follows it


@dataclass(frozen=True, slots=True)
class _Draw:
    """What is drawn for one step of one drone, used or not: so each use has its own, whatever the others do."""

    takes: float  # 0 … 1
    strays: float
    where: float
    aside: float  # standard normal
    above: float
    depth: float
    astray: float


@dataclass(slots=True)
class NoisyPilot:
    """One flight. Called with what is true of each drone that is asked for; returns the reply."""

    instruction: str
    seed: tuple[int, ...]  # the record's, the flight's
    errors: VisionErrors = field(default_factory=shipped)
    _minds: dict[int, _Mind] = field(default_factory=dict)

    def __call__(self, sights: Sequence[TrueSight]) -> str:
        """Return the reply for some drones. The nearest flies, the others hover, as under the oracle."""
        nearest = min(sights, key=lambda sight: sight.distance_m)
        return reply.fleet([self._one(sight) if sight is nearest else reply.think() for sight in sights])

    @property
    def _eye(self) -> EyeErrors:
        return self.errors.eyes[eye_of(self.instruction)]

    def _one(self, sight: TrueSight) -> str:
        eye, mind = self._eye, self._minds.setdefault(sight.drone, _Mind())
        mistaken, flight_depth = self._of_flight(eye)
        draw, attention = self._draw(sight), eye.lost if mistaken else eye.sure
        again, mind.declared = mind.declared, False
        shares = attention.kept if mind.on_target else attention.found
        if sight.visible and draw.takes < shares[band(sight.distance_m)]:
            mind.on_target, mind.astray_ned = True, None
            return self._to_target(sight, mind, self._judged(sight, eye, draw, flight_depth), again)
        mind.on_target, mind.nearer = False, False
        if again:
            mind.astray_ned, mind.turns, mind.strides = None, 0, 0
            return reply.rotate(math.copysign(_LEAVE_DEG, mind.side))
        return self._elsewhere(sight, mind, attention, eye, draw)

    def _to_target(self, sight: TrueSight, mind: _Mind, judged_ned: Vec3, again: bool) -> str:
        """Return the way to where the target is judged to be; there, a declaration, and after one in vain a stride."""
        mind.turns, mind.strides = 0, 0
        mind.side = math.copysign(1.0, sight.bearing_deg)
        if math.dist(sight.position_ned, judged_ned) > ARRIVED_M:
            told = oracle.reply(sight.position_ned, sight.yaw_rad, sight.attitude, sight.camera, judged_ned)
            mind.declared = _declares(told)
            return told
        if again and not mind.nearer:
            mind.nearer = True
            x, _ = oracle.pixel(_in_camera(sight, judged_ned), sight.camera)
            return reply.go(POINT_SPAN * x / sight.camera.width, POINT_SPAN * 0.5, _SHORTEST_M)
        mind.declared, mind.nearer = True, False
        return reply.finished()

    def _elsewhere(self, sight: TrueSight, mind: _Mind, attention: Attention, eye: EyeErrors, draw: _Draw) -> str:
        """Return what follows where the target is not taken for itself: the way to something else, or a search."""
        if mind.astray_ned is None:
            if draw.strays < attention.strays:
                mind.astray_ned = self._something(sight, eye, draw)
        elif draw.strays < attention.claims:
            mind.declared = True
            return reply.finished()
        elif draw.strays >= attention.claims + attention.stays:
            mind.astray_ned = None
        if mind.astray_ned is not None:
            told = oracle.reply(sight.position_ned, sight.yaw_rad, sight.attitude, sight.camera, mind.astray_ned)
            if not _declares(told):
                mind.turns, mind.strides = 0, 0
                return told
            mind.astray_ned = None  # it is there, and has seen by now what it is
        return self._search(mind, draw)

    def _search(self, mind: _Mind, draw: _Draw) -> str:
        """Return a turn until the circle is closed, then strides to another place, as vision searches."""
        if mind.turns < _CIRCLE:
            mind.turns += 1
            return reply.rotate(math.copysign(search.SWEEP_DEG, mind.side))
        mind.strides += 1
        if mind.strides >= _WANDERS:
            mind.turns, mind.strides = 0, 0
        u = _EDGE + draw.where * (POINT_SPAN - 2.0 * _EDGE) if mind.strides == 1 else 0.5 * POINT_SPAN
        return reply.go(u, 0.5 * POINT_SPAN, search.WANDER_M)

    def _judged(self, sight: TrueSight, eye: EyeErrors, draw: _Draw, flight_depth: float) -> Vec3:
        """Return where (m, NED) the target is taken to be: off its pixel, and nearer or farther than it is."""
        camera, true = sight.camera, _in_camera(sight, sight.target_ned)
        x, y = oracle.pixel(true, camera)
        x = min(max(x + eye.aside_px * draw.aside, 0.0), camera.width)
        y = min(max(y + eye.above_px * draw.above, 0.0), camera.height)
        factor = math.exp(eye.depth + eye.depth_flight * flight_depth + eye.depth_step * draw.depth)
        return _place(sight, x, y, true[0] * factor)

    def _something(self, sight: TrueSight, eye: EyeErrors, draw: _Draw) -> Vec3:
        """Return where (m, NED) something else is, level with the camera."""
        u = _EDGE + draw.where * (POINT_SPAN - 2.0 * _EDGE)
        depth = eye.astray_m * math.exp(eye.astray * draw.astray)
        return _place(sight, u * sight.camera.width / POINT_SPAN, 0.5 * sight.camera.height, depth)

    def _of_flight(self, eye: EyeErrors) -> tuple[bool, float]:
        """Return whether this flight is a mistaken one, and by how many deviations its depths are off (normal)."""
        rng = np.random.default_rng((*self.seed, 0))
        return bool(rng.random() < eye.mistaken), float(rng.standard_normal())

    def _draw(self, sight: TrueSight) -> _Draw:
        rng = np.random.default_rng((*self.seed, 1 + sight.step, 1 + sight.drone))
        return _Draw(*rng.random(3).tolist(), *rng.standard_normal(4).tolist())


def _declares(told: str) -> bool:
    return bool(json.loads(told)["action"] == FINISHED)


def _in_camera(sight: TrueSight, point_ned: Vec3) -> Vec3:
    return oracle.in_camera(sight.position_ned, sight.attitude, sight.camera, point_ned)


def _place(sight: TrueSight, x: float, y: float, depth_m: float) -> Vec3:
    """Return the place (m, NED) at a pixel and a depth."""
    camera, ahead = sight.camera, sight.camera.offset_frd
    right = depth_m * (x - camera.width / 2.0) / camera.focal_px
    below = depth_m * (y - camera.height / 2.0) / camera.focal_px
    north, east, down = rotate(sight.attitude, (ahead[0] + depth_m, ahead[1] + right, ahead[2] + below))
    return (sight.position_ned[0] + north, sight.position_ned[1] + east, sight.position_ned[2] + down)
