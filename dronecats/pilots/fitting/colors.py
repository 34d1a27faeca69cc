"""Fits the network of `color_detector`, and makes the outlines (outer points of targets) that `ranging` uses.

The pictures show neighbourhoods: the residential map with seeds that no episode record uses. The seed sets houses,
plants and most parked cars. Streets and plots are the same for all seeds. Each picture has its own target position,
paint and direction of view.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting import training
from dronecats.pilots.fitting.training import BATCH, CAMERA, Examples, Floats, OutputGradient
from dronecats.pilots.vision import color_detector, color_target
from dronecats.pilots.vision.color_detector import CHANNELS, LENGTH, SIDE, PatchNetwork
from dronecats.pilots.vision.colors import Picture
from dronecats.pilots.vision.command import read_referent
from dronecats.pilots.vision.pilot import decode
from dronecats.pilots.vision.ranging import BoundingBox
from episodes import maps
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets, residential_places
from episodes.maps.scene import Instance, Moved, Scene
from foundation.camera import CameraPose
from foundation.frames import Vec3, quat_from_euler, rotate
from foundation.protocol import RADIUS_M

NOUNS = {
    "suv": "SUV", "sedan": "sedan", "hatchback": "hatchback", "pickup": "pickup truck", "van": "van", "bus": "bus",
    "motorcycle": "motorcycle", "cyclist": "cyclist", "quadrotor": "quadrotor",
}  # fmt: skip
"""Target of a residential record → noun of its instruction."""
PAINTS = ("cyan", "red", "yellow", "orange", "blue", "green", "purple", "pink", "brown")
PLACES = {  # target → places where it stands; other targets stand at USUAL_PLACES
    "bus": ("bus stop",),
    "cyclist": ("pavement", "lawn"),
    "quadrotor": ("lawn",),
    "motorcycle": ("kerb", "drive"),
}
USUAL_PLACES = ("kerb", "drive")
HEIGHTS_M = (1.1, 2.9)  # m, range of the drone's height above the ground
DISTANCES_M = (3.0, 32.0)  # m, range of the distance from the body to the target's centre
ASIDE_RAD = math.radians(40.0)  # largest angle between the drone's nose and the target
ABSENT = 0.25  # share of the pictures that face away from the target
TILT_RAD = 0.02  # standard deviation of pitch and roll; the drone is not quite level after braking
ROOM_M = 0.9  # m, least depth in a picture; a picture with a nearer obstacle is dropped
LEAST_PX = 40  # least number of pixels of a visible target


@dataclass(frozen=True, slots=True)
class Target:
    """The target that a picture's instruction names."""

    asset: str
    paint: str
    distance_m: float  # from the body's origin to the middle of the target's 3-D bounding box
    box: tuple[int, int, int, int] | None  # px, left, top, right, bottom of the target's pixels; None: not visible

    @property
    def instruction(self) -> str:
        return f"go to the {self.paint} {NOUNS[self.asset]}"


def build(seed: int) -> Scene:
    """Return a neighbourhood with three movable targets of each kind in NOUNS, in different paints."""
    built = maps.build("residential", seed)
    rng = np.random.default_rng((seed, 11))
    first = max(i.id for i in built.instances) + 1
    added: list[Instance] = []
    for asset in NOUNS:
        for paint in rng.permutation(PAINTS)[:3].tolist():
            mesh = assets.build(asset, paint)
            name = f"{asset} {paint}"
            added.append(Instance(first + len(added), name, "target", mesh, (0.0, 0.0, 0.0), movable=True))
    return replace(built, instances=(*built.instances, *added), base=built)


def photograph(scene: Scene, renderer: Renderer, seed: int, count: int) -> Iterator[tuple[NDArray[np.uint8], Target]]:
    """Yield RGB pictures (360, 640, 3) from random poses with their targets; a share ABSENT faces away from these."""
    rng = np.random.default_rng((seed, 12))
    spots = residential_places.places(seed).spots
    targets = [i for i in scene.instances if i.kind == "target"]
    nowhere: Moved = {i.id: None for i in targets}
    done = 0
    while done < count:
        vehicle = targets[int(rng.integers(len(targets)))]
        asset, paint = vehicle.name.split(" ")
        fitting = [s for s in spots if s.place in PLACES.get(asset, USUAL_PLACES)]
        spot = fitting[int(rng.integers(len(fitting)))]
        yaw = spot.yaw + float(rng.choice((0.0, math.pi))) + float(rng.normal(0.0, 0.4))
        low, high = vehicle.mesh.vertices.min(axis=0), vehicle.mesh.vertices.max(axis=0)
        middle = _middle(spot.position_ned, yaw, 0.5 * (low + high))
        distance = math.exp(float(rng.uniform(*np.log(DISTANCES_M))))
        way = float(rng.uniform(-math.pi, math.pi))
        north, east = middle[0] - distance * math.cos(way), middle[1] - distance * math.sin(way)
        body = (north, east, scene.terrain.at(north, east) - float(rng.uniform(*HEIGHTS_M)))
        aside = float(rng.uniform(-ASIDE_RAD, ASIDE_RAD))
        if rng.random() < ABSENT:
            aside += math.pi
        tilt = rng.normal(0.0, TILT_RAD, 2)
        attitude = quat_from_euler(float(tilt[0]), float(tilt[1]), way + aside)
        lever = rotate(attitude, CAMERA.offset_frd)
        eye = (body[0] + lever[0], body[1] + lever[1], body[2] + lever[2])
        view = renderer.render(CameraPose(eye, attitude), {**nowhere, vehicle.id: (spot.position_ned, yaw)})
        if float(view.depth.min()) < ROOM_M or float(np.median(view.depth)) < 2.5:
            continue
        done += 1
        rows, columns = np.nonzero(view.ids == vehicle.id)
        box = None
        if len(rows) >= LEAST_PX:
            box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        yield view.rgb, Target(asset, paint, math.dist(body, middle), box)


def _middle(place: Vec3, yaw: float, local: NDArray[np.floating]) -> Vec3:
    x, y, z = (float(v) for v in local)
    c, s = math.cos(yaw), math.sin(yaw)
    return (place[0] + c * x - s * y, place[1] + s * x + c * y, place[2] + z)


OUTLINES = "outlines.npz"
FIT_SEED, CHECK_SEED = 320, 300  # first seeds of the neighbourhoods of the fit, and of the check
SCENES, PICTURES, ROUNDS = 14, 180, 40  # defaults of the options with these names
SHORT_PICTURES = 12
CHECK_SCENES, CHECK_PICTURES = 4, 160

# Labels of patches. A patch is the target if its intersection over union with the target's box is at least
# POSITIVE_IOU. It is not the target if at most the share NEGATIVE_SHARE of the patch is inside that box. Other patches,
# such as one door of a bus, are not used.
POSITIVE_IOU, NEGATIVE_SHARE = 0.5, 0.2
ABSENT_TARGETS = 4  # additional instructions per picture, with targets that the picture does not show
LIKE_BRICK = ("brown", "red", "orange")  # colours of houses and fences, used more often for absent targets

HIDDEN = 48  # units of the hidden layer
DECAY = 4e-4  # weight decay
CELL_DROPOUT = 0.15  # share of a patch's cells that are set to zero in each example
BRIGHTNESS_LOG_STD = 0.2  # standard deviation of the log of the brightness factor
DISTANCE_WEIGHT = 2.0  # the distance error has 0.1 × this weight relative to the cross-entropy
DISTANCE_SCALE = 0.15  # scale of the distance output: standard deviation of its labels
_CELLS = SIDE * SIDE
_PATCH = _CELLS * CHANNELS

NETWORK = PatchNetwork
BANDS_M = (3.0, 5.0, 7.0, 10.0, 15.0, 22.0, 32.5)  # m, edges of the distance bands of the check
ASIDE_PX = 4  # px; the middle of a correct detection is at most this far left or right of the target's box

# Outlines for `ranging`
OUTLINE_PAINT = "red"  # the shape is the same for every paint
LEVELS = 6  # height bands of an outline
DIRECTIONS = 8  # horizontal directions; in each direction, an outline has the outermost points of each band
STEEP = 6.0  # slope of steep directions, up and down; an outline also has its outermost point in each of these

TargetJpeg = tuple[bytes, Target]


@dataclass(frozen=True, slots=True)
class DetectionResult:
    """The detection for one picture's instruction."""

    target: Target
    detected_m: float | None  # estimated distance; None without a detection
    is_right: bool  # the detection is the target


draw = partial(training.draw, build, photograph)


def examples_of(picture: Picture, target: Target, rng: np.random.Generator) -> Examples:
    """Return the patches of a picture for the instruction of its target, and for instructions of absent targets.

    Labels (N, 2) of the target: 1, log(true distance / distance estimated by size). Labels of other patches: 0, 0.
    """
    wanted = [(target.asset, target.paint)]
    while len(wanted) <= ABSENT_TARGETS:
        paints = LIKE_BRICK if rng.random() < 0.5 else PAINTS
        absent = (str(rng.choice(list(NOUNS))), str(rng.choice(paints)))
        if absent[1] != target.paint:
            wanted.append(absent)
    inputs, labels = [], []
    for asset, paint in wanted:
        patches, rows = color_detector.color_patches(picture, read_referent(f"go to the {paint} {NOUNS[asset]}"))
        is_present = (asset, paint) == (target.asset, target.paint)
        for patch, row in zip(patches, rows, strict=True):
            union, inside = overlap(patch.box, target.box, picture.shape[:2])
            is_part = inside > NEGATIVE_SHARE
            if (is_present and union >= POSITIVE_IOU) or not is_part:
                inputs.append(row)
                labels.append((float(is_part), np.log(target.distance_m / patch.range.distance_m) if is_part else 0.0))
    array = np.array(inputs, np.float16).reshape(-1, LENGTH)
    return Examples(array, np.array(labels, np.float32).reshape(-1, 2))


def overlap(box: BoundingBox, true: tuple[int, int, int, int] | None, shape: tuple[int, int]) -> tuple[float, float]:
    """Return the intersection over union of two rectangles, and the share of the first one inside the second one."""
    if true is None:
        return 0.0, 0.0
    height, width = shape
    left, right = ((x + 0.5) * width for x in (box.left, box.right))
    top, bottom = (y * width + 0.5 * height for y in (box.top, box.bottom))
    wide = max(0.0, min(right, true[2]) - max(left, true[0]))
    common = wide * max(0.0, min(bottom, true[3]) - max(top, true[1]))
    area, true_area = (right - left) * (bottom - top), (true[2] - true[0]) * (true[3] - true[1])
    return common / max(1e-9, area + true_area - common), common / max(1e-9, area)


def fit_scenes(scenes: int, pictures: int, rounds: int) -> PatchNetwork:
    """Return a network fitted to `scenes` neighbourhoods with `pictures` pictures each."""
    rng = np.random.default_rng(5)
    jpegs = draw(FIT_SEED, scenes, pictures)
    return fit(Examples.join(examples_of(decode(data), target, rng) for data, target in jpegs), rounds, 1)


def fit(examples: Examples, rounds: int, seed: int) -> PatchNetwork:
    """Return a network fitted in `rounds` passes over the examples. Equal arguments give the same network."""
    rng = np.random.default_rng((seed, 32))
    sample = examples.inputs[:: max(1, len(examples.inputs) // 6000)].astype(np.float32)
    mean, deviation = sample.mean(axis=0), np.maximum(sample.std(axis=0), 0.05)
    steps = rounds * (len(examples.labels) // BATCH)
    examples_seen = _batches(examples, rounds, mean, deviation, rng)
    hidden, hidden_bias, out, out_bias = training.fit(examples_seen, mean, deviation, (HIDDEN, 2), steps, DECAY, rng)
    scale = np.array((1.0, DISTANCE_SCALE), np.float32)  # `cost_gradient` divides the distance labels by this
    return PatchNetwork(hidden, hidden_bias, out * scale, out_bias * scale)


def mirrored(inputs: Floats) -> Floats:
    """Return inputs (N, LENGTH) mirrored left to right."""
    patch = inputs[:, :_PATCH].reshape(-1, SIDE, SIDE, CHANNELS)[:, :, ::-1]
    rest = inputs[:, _PATCH:].copy()
    rest[:, [0, 1]] = -rest[:, [1, 0]]  # the rectangle's left and right
    rest[:, [9, 10]] = rest[:, [10, 9]]  # whether the left and right side touch the picture's edge
    return np.concatenate((patch.reshape(len(inputs), _PATCH), rest), axis=1)


def _batches(
    examples: Examples, rounds: int, mean: Floats, deviation: Floats, rng: np.random.Generator
) -> Iterator[tuple[Floats, OutputGradient]]:
    yes = np.flatnonzero(examples.labels[:, 0] > 0.5)
    no = np.flatnonzero(examples.labels[:, 0] < 0.5)
    # targets are rarer, so they are drawn repeatedly, until they are a third of the examples
    orders = (
        rng.permutation(np.concatenate((no, rng.choice(yes, max(1, len(no) // 2)))))[: len(examples.labels)]
        for _ in range(rounds)
    )
    for x, labels in training.batches(examples, orders, mirrored, rng):
        patch = x[:, :_PATCH].reshape(len(x), _CELLS, CHANNELS)
        patch[:, :, :3] *= np.minimum(np.exp(rng.normal(0.0, BRIGHTNESS_LOG_STD, (len(x), 1, 1))), 1.15).astype(
            np.float32
        )
        x = (np.concatenate((patch.reshape(len(x), _PATCH), x[:, _PATCH:]), axis=1) - mean) / deviation
        visible = (rng.random((len(x), _CELLS), np.float32) >= CELL_DROPOUT) / np.float32(1.0 - CELL_DROPOUT)
        x[:, :_PATCH] *= np.repeat(visible, CHANNELS, axis=1)
        yield x, cost_gradient(labels)


def cost_gradient(labels: NDArray[np.floating]) -> OutputGradient:
    """Return a function that computes the gradient of the mean cost: cross-entropy plus the targets' distance error."""
    is_target, factor = labels.T

    def gradient(outputs: NDArray[np.floating]) -> NDArray[np.floating]:
        error = np.empty_like(outputs)
        error[:, 0] = 1.0 / (1.0 + np.exp(-np.clip(outputs[:, 0], -30.0, 30.0))) - is_target
        # clip the error at 3 DISTANCE_SCALE, because estimates for partly hidden objects are always far off
        error[:, 1] = is_target * 0.1 * DISTANCE_WEIGHT * np.clip(outputs[:, 1] - factor / DISTANCE_SCALE, -3.0, 3.0)
        error /= len(is_target)
        return error

    return gradient


def outline(asset: str) -> NDArray[np.float32]:
    """Return the distinct outer points (P, 3) of an asset's painted surface: m forward, right and up."""
    mesh = assets.build(asset, OUTLINE_PAINT)
    names = (f"paint-{OUTLINE_PAINT}", f"cloth-{OUTLINE_PAINT}")
    painted = [i for i, material in enumerate(mesh.materials) if material.name in names]
    corners = mesh.vertices[mesh.triangles[np.isin(mesh.material, painted)]]  # (T, 3, 3)
    a, b = (v.ravel() for v in np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9)))
    a, b = a[a + b <= 1.0], b[a + b <= 1.0]
    surface = np.einsum("kp,tkc->tpc", np.stack((a, b, 1.0 - a - b)), corners).reshape(-1, 3) * (1.0, 1.0, -1.0)
    edges = np.linspace(surface[:, 2].min(), surface[:, 2].max(), LEVELS + 1)
    turns = np.arange(DIRECTIONS) * 2.0 * np.pi / DIRECTIONS
    points = []
    for low, high in pairwise(edges.tolist()):
        level = surface[(surface[:, 2] >= low) & (surface[:, 2] <= high)]
        for turn in turns:
            out = level @ (np.cos(turn), np.sin(turn), 0.0)
            outermost = level[out >= out.max() - 0.03] if len(level) else level
            if len(outermost):
                points += [outermost[outermost[:, 2].argmin()], outermost[outermost[:, 2].argmax()]]
    for turn in turns:
        for up in (-STEEP, STEEP):
            points.append(surface[(surface @ (np.cos(turn), np.sin(turn), up)).argmax()])
    return np.unique(np.round(np.array(points), 2).astype(np.float32), axis=0)


def evaluate(network: PatchNetwork, jpegs: Iterable[TargetJpeg]) -> list[DetectionResult]:
    results = []
    for data, target in jpegs:
        detection = color_detector.find(decode(data), read_referent(target.instruction), network=network)
        middle = CAMERA.width * (0.5 + 0.5 * (detection.box.left + detection.box.right)) if detection else math.nan
        is_right = target.box is not None and target.box[0] - ASIDE_PX <= middle <= target.box[2] + ASIDE_PX
        results.append(DetectionResult(target, detection.range.distance_m if detection else None, is_right))
    return results


def save(network: PatchNetwork, folder: Path) -> None:
    """Write the network, and the outlines of all assets that may be the target of a residential record."""
    outlines: dict[str, Any] = {asset: outline(asset) for asset in NOUNS}
    np.savez(folder / OUTLINES, **outlines)
    network.save(folder / network.FILE)


def print_table(network: PatchNetwork, jpegs: Iterable[TargetJpeg]) -> None:
    """Print the rates and distance errors of a network's detections, by distance and kind, and its false detections."""
    results = evaluate(network, jpegs)
    groups: dict[str, list[DetectionResult]] = defaultdict(list)
    for result in results:
        if result.target.box is not None:
            for low, high in pairwise(BANDS_M):
                if low <= result.target.distance_m < high:
                    groups[f"{low:g}–{high:g} m"].append(result)
    for asset in NOUNS:
        groups[asset] = [r for r in results if r.target.asset == asset and r.target.box is not None]
    print(f"{'':12}| found   | range / truth: 10 %, half, 90 % ")
    for name, members in groups.items():
        ratios = [r.detected_m / r.target.distance_m for r in members if r.is_right and r.detected_m]
        spread = " ".join(f"{v:5.2f}" for v in np.percentile(ratios, (10, 50, 90))) if ratios else ""
        print(f"{name:12}| {sum(r.is_right for r in members):3}/{len(members):<3} | {spread}")
    present, absent = ([r for r in results if (r.target.box is None) == is_absent] for is_absent in (False, True))
    false = sum(r.detected_m is not None for r in absent)
    wrong = sum(r.detected_m is not None and not r.is_right for r in present)
    near = [r for r in results if r.is_right and r.detected_m and r.detected_m <= color_target.ARRIVED_M]
    far = sum(r.target.distance_m > RADIUS_M for r in near)
    print(f"detections of absent targets: {false}/{len(absent)}")
    print(f"wrong detections of present targets: {wrong}/{len(present)}")
    print(f"estimated within reach: {len(near)}, of which outside the radius of success: {far}")
