"""Fits the network of `shape_detector` to pictures of random campuses.

A random campus has the ground and the halls of the shipped campus, but the halls swap places. The things of the asset
catalogue stand at random places, the plants have random shapes, and the sun has a random time.

Stage 1 fits a first network to windows (parts of a picture, see `shape_detector`) of the first campuses: all windows
with a thing, and random empty windows. Stage 2 adds windows of all campuses: all with a thing, and empty windows that
the first network mistakes for a thing. The shipped network is fitted to the windows of both stages.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting import training
from dronecats.pilots.fitting.training import BATCH, CAMERA, Examples, Floats, OutputGradient
from dronecats.pilots.vision import shape_detector
from dronecats.pilots.vision.colors import Picture
from dronecats.pilots.vision.pilot import decode
from dronecats.pilots.vision.shape_detector import KINDS, ShapeNetwork
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets, campus, campus_ground, campus_plan
from episodes.maps.assets import buildings, campus_fixtures, people, plants, service_vehicles
from episodes.maps.scene import Instance, Mesh, Scene, sun_at
from foundation.camera import CameraPose
from foundation.frames import Vec3, quat_from_euler

EXTENT = ((-80.0, 46.0), (-50.0, 52.0))  # m, north and east: the area where things stand
COPIES = {"bench": 12, "bin": 8, "lamp": 12, "person": 26, "tree": 18, "bollard": 8, "conifer": 8, "shrub": 20}
DISTRACTORS = 11  # number of copies of each kind that is not in COPIES
APART_M = 2.6  # least distance between the middles of two things
HEIGHTS_M = (1.0, 2.4)  # m, range of the camera's height above the ground
FARTHEST_M = 50.0  # greatest depth of a thing that counts as visible
TILT_RAD = 0.025  # standard deviation of pitch and roll in half of the pictures; the others are level


@dataclass(frozen=True, slots=True)
class VisibleThing:
    kind: str
    depth_m: float  # along the optical axis, to the thing's middle
    right_m: float  # right of the optical axis
    below_m: float  # height of the camera above the thing's foot
    box: tuple[int, int, int, int]  # px, left, top, right, bottom of the thing's pixels
    pixels: int  # number of visible pixels
    box_pixels: float  # px, area of the unobstructed thing's box


def makers(rng: np.random.Generator) -> dict[str, Mesh]:
    """Return a mesh for each kind of thing; plants have random shapes."""
    made = {kind: maker() for kind, maker in assets.FIXTURES.items()}
    made["tiered-fountain"] = campus_fixtures.fountain(3)
    made["person"] = people.passer_by(0)
    made["delivery-robot"] = service_vehicles.delivery_robot("white")
    made["service-cart"] = service_vehicles.service_cart("white")
    species = str(rng.choice(plants.BROADLEAVES))
    made["tree"] = plants.tree(species, float(rng.uniform(6.0, 8.0)), int(rng.integers(3, 9)))
    made["conifer"] = plants.conifer(float(rng.uniform(7.0, 11.0)), int(rng.integers(3, 9)))
    made["shrub"] = plants.bush(float(rng.uniform(0.4, 0.6)), int(rng.integers(3, 9)))
    return made


def build(seed: int) -> Scene:
    rng = np.random.default_rng((seed, 4711))
    terrain = campus_ground.terrain()
    instances: list[Instance] = []

    def add(kind: str, mesh: Mesh, north: float, east: float, yaw: float, down: float | None = None) -> None:
        place = (north, east, terrain.at(north, east) if down is None else down)
        instances.append(Instance(len(instances) + 1, f"{kind}-{len(instances)}", kind, mesh, place, yaw))

    for use, mesh in campus_ground.ground():
        instances.append(Instance(len(instances) + 1, use, "ground", mesh, (0.0, 0.0, 0.0)))
    plans = [plan for plan, *_ in campus_plan.HALLS]
    feet: list[tuple[float, float, float, float]] = []  # north, east, half depth, half width of the halls
    for k, (_, north, east, facing) in zip(rng.permutation(len(plans)), campus_plan.HALLS, strict=True):
        plan, yaw = plans[int(k)], math.radians(facing)
        out = plan.depth / 2 + 2.0
        add(
            "hall",
            buildings.hall(plan),
            north,
            east,
            yaw,
            terrain.at(north + math.cos(yaw) * out, east + math.sin(yaw) * out),
        )
        forward, back, side = buildings.reach(plan)
        deep, wide = max(forward, back) + 0.6, side + 0.6
        feet.append((north, east, *((deep, wide) if facing in (0.0, 180.0) else (wide, deep))))
    made = makers(rng)
    taken: list[tuple[float, float]] = []
    for kind in sorted(made):
        for _ in range(COPIES.get(kind, DISTRACTORS if kind != "clock-tower" else 2)):
            for _ in range(20):
                n, e = (float(rng.uniform(*span)) for span in EXTENT)
                apart = all(math.hypot(n - a, e - b) > APART_M for a, b in taken)
                if apart and not any(abs(n - a) < h and abs(e - b) < w for a, b, h, w in feet):
                    taken.append((n, e))
                    add(kind, _with_random_clothes(kind, made[kind], rng), n, e, float(rng.uniform(-math.pi, math.pi)))
                    break
    for side in (-1, 1):
        for along in (-90.0, -30.0, 30.0, 90.0):
            add("wood", plants.wood(64.0, 10.0, 3), side * 104.0, along, math.pi / 2)
            add("wood", plants.wood(64.0, 10.0, 4), along, side * 104.0, 0.0)
    sun = sun_at(campus.ORIGIN[0], int(rng.integers(110, 170)), float(rng.uniform(9.4, 11.4)))
    return replace(campus.build(1), name=f"campus-of-{seed}", instances=tuple(instances), sun=sun)


def _with_random_clothes(kind: str, mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return a person with random clothes and posture instead of `mesh`; the mesh of another kind is unchanged."""
    if kind != "person":
        return mesh
    paint = str(rng.choice(assets.PAINTS))
    if rng.random() < 0.4:
        return people.passer_by(int(rng.integers(16)))
    return people.pedestrian(paint) if rng.random() < 0.5 else people.person(paint)


def photograph(
    scene: Scene, renderer: Renderer, seed: int, count: int
) -> Iterator[tuple[NDArray[np.uint8], tuple[VisibleThing, ...]]]:
    """Yield `count` pictures (360, 640, 3) RGB from random places of a campus, each with its visible things."""
    rng = np.random.default_rng((seed, 815))
    instances = [i for i in scene.instances if i.kind not in ("ground", "wood", "hall")]
    halls = [i for i in scene.instances if i.kind == "hall"]
    done = 0
    while done < count:
        n, e = (float(rng.uniform(*span)) for span in EXTENT)
        yaw = float(rng.uniform(-math.pi, math.pi))
        near = min(math.hypot(i.position_ned[0] - n, i.position_ned[1] - e) for i in instances)
        if near < 2.0 or any(math.dist((n, e), h.position_ned[:2]) < 16.0 for h in halls):
            continue
        height = float(rng.uniform(*HEIGHTS_M))
        eye = (n, e, scene.terrain.at(n, e) - height)
        tilt = [float(v) for v in rng.normal(0.0, TILT_RAD, 2)] if rng.random() < 0.5 else [0.0, 0.0]
        view = renderer.render(CameraPose(eye, quat_from_euler(tilt[0], tilt[1], yaw)))
        done += 1
        yield view.rgb, tuple(_visible(view.ids, instances, eye, yaw))


def _visible(ids: NDArray[np.int32], instances: list[Instance], eye: Vec3, yaw: float) -> Iterator[VisibleThing]:
    counts = np.bincount(ids.ravel(), minlength=max(i.id for i in instances) + 1)
    c, s = math.cos(yaw), math.sin(yaw)
    for instance in instances:
        if counts[instance.id] < 12:
            continue
        north, east = instance.position_ned[0] - eye[0], instance.position_ned[1] - eye[1]
        depth, right = c * north + s * east, -s * north + c * east
        if depth > FARTHEST_M or depth < 1.0:
            continue
        rows, columns = np.nonzero(ids == instance.id)
        low, high = instance.mesh.vertices.min(axis=0), instance.mesh.vertices.max(axis=0)
        wide = 0.5 * (high[0] - low[0] + high[1] - low[1])
        box_pixels = float(wide * -low[2]) * (CAMERA.focal_px / depth) ** 2
        box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        below = instance.position_ned[2] - eye[2]
        yield VisibleThing(instance.kind, depth, right, below, box, int(counts[instance.id]), box_pixels)


FIT_SEED, CHECK_SEED = 200, 900  # first seeds of the campuses to fit to, and of the campuses to check with
SCENES, PICTURES, ROUNDS = 96, 28, 60  # defaults of the options with these names
FIRST_SCENES, FIRST_ROUNDS = 8, 14  # campuses and rounds for the fit of the first network
SHORT_PICTURES = 4
CHECK_SCENES, CHECK_PICTURES = 4, 24

# Limits of the offset from a window to a thing: log of the ratio of distances, offset aside (m), offset in height (m).
# A window within EXAMPLE_TOLERANCE is an example of the thing. Other windows within UNUSED_TOLERANCE are not used.
# Windows farther off, within PARTIAL_TOLERANCE, show a part of the thing; some are examples of an empty window.
EXAMPLE_TOLERANCE = (0.10, 0.36, 0.17)
UNUSED_TOLERANCE = (0.26, 0.90, 0.40)
PARTIAL_TOLERANCE = (0.60, 1.6, 0.80)
# m, least second limit of the last two tuples for these wide things
WIDE_M = {"fountain": 1.8, "tiered-fountain": 1.8, "clock-tower": 1.8, "kiosk": 1.3, "bike-rack": 1.3}
VISIBLE_SHARE_LIMITS = (
    0.15,
    0.40,
)  # visible share: below the first, a thing counts as absent; between the two, its windows are not used
NO_EXAMPLE = -1  # label of a window that is not used
RANDOM_WINDOWS, MISTAKEN_WINDOWS = 50, 45  # empty windows per picture: random ones, and ones mistaken for a thing
DISPLACED_WINDOWS = 12  # empty windows per picture that show a part of a thing
MOST_MISTAKES = 6  # largest number of mistaken windows for each picture, distance and height
USUAL_WINDOWS = 5000.0  # usual number of windows per picture; sets the probability to draw a random window
USUAL_PERCENTILE, USUAL_WITHIN_M = 85.0, 30.0  # percentile in `usual_fill`, over things nearer than USUAL_WITHIN_M (m)

HIDDEN = 80  # units of the hidden layer
DECAY = 2e-4  # weight decay
COVERED = 0.2  # share of a window's cells that are blanked in a training step
BRIGHTNESS_LOG_STD = 0.25  # standard deviation of the log of a brightness factor, which imitates shadows

NETWORK = ShapeNetwork
CHECKED_M = (3.2, 20.0, 40.0)  # m, edges of the two distance bands of the check, near and far
PLAINLY = 0.5  # visible share from which a thing must be detected
ODDS = (-0.9, 0.3, 1.5)  # log odds from which a thing counts as detected; the printed table has all three

CampusJpeg = tuple[bytes, tuple[VisibleThing, ...]]


draw = partial(training.draw, build, photograph)


def usual_fill(jpegs: Iterable[CampusJpeg]) -> dict[str, float]:
    """Return for each kind the share of its `box_pixels` that an unobstructed thing usually fills."""
    shares: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for _, items in jpegs:
        for item in items:
            shares[item.kind].append((item.depth_m, item.pixels / item.box_pixels))
    fill = {}
    for kind, pairs in shares.items():
        near = [share for depth, share in pairs if depth < USUAL_WITHIN_M]
        fill[kind] = float(np.percentile(near or [share for _, share in pairs], USUAL_PERCENTILE))
    return fill


def labels(
    strip: shape_detector.Strip,
    height: int,
    items: Iterable[VisibleThing],
    fill: dict[str, float],
    near: tuple[float, float, float] = UNUSED_TOLERANCE,
) -> NDArray[np.int8]:
    """Return for each window of a strip the index of its thing in KINDS, 0 for nothing, or NO_EXAMPLE.

    `height`: index of `shape_detector.HEIGHTS_M`; `fill`: from `usual_fill`; `near`: limits of the offset from a thing.
    A window within these limits that is not an example of the thing gets NO_EXAMPLE.
    """
    right = strip.rights_m()
    kinds = np.zeros(len(right), np.int8)
    offsets = np.full(len(right), np.inf)
    for item in items:
        if item.kind not in KINDS:
            continue
        share = item.pixels / (item.box_pixels * fill[item.kind])
        # offset aside at the strip's depth, after moving the thing there along its line of sight
        depth_off = abs(np.log(item.depth_m / strip.depth_m))
        aside = np.abs(right - item.right_m * strip.depth_m / item.depth_m)
        height_off = abs(item.below_m - shape_detector.HEIGHTS_M[height])
        if share < VISIBLE_SHARE_LIMITS[0] or depth_off > near[0] or height_off > near[2]:
            continue
        is_near = aside < max(WIDE_M.get(item.kind, 0.0), near[1])
        is_example = (
            depth_off < EXAMPLE_TOLERANCE[0] and height_off < EXAMPLE_TOLERANCE[2] and share >= VISIBLE_SHARE_LIMITS[1]
        )
        holds = aside < EXAMPLE_TOLERANCE[1] if is_example else np.zeros_like(is_near)
        offset = depth_off / EXAMPLE_TOLERANCE[0] + aside / EXAMPLE_TOLERANCE[1] + height_off / EXAMPLE_TOLERANCE[2]
        kinds[is_near & ~holds & (kinds == 0)] = NO_EXAMPLE
        better = holds & (offset < offsets)
        kinds[better] = KINDS.index(item.kind)
        offsets[better] = offset[better]
    return kinds


def examples_of(
    picture: Picture,
    items: tuple[VisibleThing, ...],
    fill: dict[str, float],
    rng: np.random.Generator,
    empty_windows: int,
    network: ShapeNetwork | None = None,
) -> Examples:
    """Return windows of one picture: all that hold a thing, and at most `empty_windows` that hold nothing.

    Inputs: windows (N, rows · columns · CHANNELS). Labels: indices into KINDS.

    Without a network, the empty windows are random. With a network, they are the windows that the network most mistakes
    for a thing, plus up to DISPLACED_WINDOWS that show a part of a thing.
    """
    windows, kinds = list[NDArray[np.float16]](), list[NDArray[np.int8]]()
    empty, rank, displaced = list[NDArray[np.float16]](), list[NDArray[np.float64]](), list[NDArray[np.float16]]()
    for strip in shape_detector.strips(picture):
        for height in range(len(shape_detector.HEIGHTS_M)):
            window_kinds = labels(strip, height, items, fill)
            holds = np.flatnonzero(window_kinds > 0)
            nothing = np.flatnonzero(window_kinds == 0)
            if network is None:
                nothing = nothing[rng.random(len(nothing)) < empty_windows / USUAL_WINDOWS]
            if not len(holds) and not len(nothing):
                continue
            seen = strip.windows(height)
            windows.append(seen[holds].astype(np.float16))
            kinds.append(window_kinds[holds])
            if network is None:
                empty.append(seen[nothing].astype(np.float16))
                rank.append(rng.random(len(nothing)))
                continue
            is_part = labels(strip, height, items, fill, PARTIAL_TOLERANCE)[nothing] != 0
            displaced.append(seen[rng.permutation(nothing[is_part])[:1]].astype(np.float16))
            clear = nothing[~is_part]
            mistake = 1.0 - network.probabilities(seen[clear])[:, 0]
            worst = np.argsort(-mistake)[:MOST_MISTAKES]
            empty.append(seen[clear[worst]].astype(np.float16))
            rank.append(-mistake[worst].astype(np.float64))
    chosen = np.concatenate(empty)[np.argsort(np.concatenate(rank), kind="stable")[:empty_windows]]
    beside = rng.permutation(np.concatenate(displaced))[:DISPLACED_WINDOWS] if displaced else chosen[:0]
    none = np.concatenate((chosen, beside))
    return Examples(np.concatenate((*windows, none)), np.concatenate((*kinds, np.zeros(len(none), np.int8))))


def collect(
    jpegs: list[CampusJpeg], fill: dict[str, float], seed: int, empty: int, network: ShapeNetwork | None = None
) -> Examples:
    """Return the examples of all pictures. `empty`: windows per picture that hold nothing."""
    rng = np.random.default_rng((seed, 77))
    return Examples.join(examples_of(decode(data), items, fill, rng, empty, network) for data, items in jpegs)


def fit_scenes(scenes: int, pictures: int, rounds: int) -> ShapeNetwork:
    """Return the network fitted to `pictures` pictures of each of `scenes` campuses in `rounds` rounds."""
    jpegs = list(draw(FIT_SEED, scenes, pictures))
    fill = usual_fill(jpegs)
    random = collect(jpegs[: min(FIRST_SCENES, scenes) * pictures], fill, 1, RANDOM_WINDOWS)
    mistaken = collect(jpegs, fill, 2, MISTAKEN_WINDOWS, fit(random, FIRST_ROUNDS, 1))
    return fit(Examples.join((random, mistaken)), rounds, 2)


def fit(examples: Examples, rounds: int, seed: int) -> ShapeNetwork:
    """Return a network fitted in `rounds` passes over the examples. Equal arguments give the same network."""
    rng = np.random.default_rng((seed, 31))
    cells = examples.inputs[:: max(1, len(examples.inputs) // 4000)].astype(np.float32)
    channels = cells.reshape(-1, shape_detector.CHANNELS)
    length = examples.inputs.shape[1]
    repeats = length // shape_detector.CHANNELS
    mean = np.tile(np.asarray(channels.mean(axis=0), np.float32), repeats)
    deviation = np.tile(np.asarray(channels.std(axis=0), np.float32), repeats)
    steps = rounds * (len(examples.labels) // BATCH)
    windows = _batches(examples, rounds, mean, deviation, rng)
    return ShapeNetwork(*training.fit(windows, mean, deviation, (HIDDEN, len(KINDS)), steps, DECAY, rng))


def mirrored(windows: Floats) -> Floats:
    """Return windows (N, rows · columns · CHANNELS) with left and right, and the two diagonal gradients, swapped."""
    cells = windows.reshape(-1, *shape_detector.WINDOW, shape_detector.CHANNELS)[:, :, ::-1]
    return np.ascontiguousarray(cells[..., [0, 1, 2, 3, 4, 7, 6, 5]]).reshape(windows.shape)


def _batches(
    examples: Examples, rounds: int, mean: Floats, deviation: Floats, rng: np.random.Generator
) -> Iterator[tuple[Floats, OutputGradient]]:
    orders = (rng.permutation(len(examples.labels)) for _ in range(rounds))
    for x, kinds in training.batches(examples, orders, mirrored, rng):
        light = np.exp(rng.normal(0.0, BRIGHTNESS_LOG_STD, (len(x), 1))).astype(np.float32)
        x = x * np.minimum(light, 1.15)
        visible = rng.random((len(x), x.shape[1] // shape_detector.CHANNELS), np.float32) >= COVERED
        factor = np.repeat(visible / np.float32(1.0 - COVERED), shape_detector.CHANNELS, axis=1)
        yield np.asarray((x - mean) / deviation * factor, np.float32), cross_entropy_gradient(kinds)


def cross_entropy_gradient(kinds: NDArray[np.int8]) -> OutputGradient:
    """Return a function that computes the gradient of the mean cross-entropy with respect to the network's outputs."""

    def gradient(outputs: NDArray[np.floating]) -> NDArray[np.floating]:
        error: NDArray[np.floating] = np.exp(outputs - outputs.max(axis=1, keepdims=True))
        error /= error.sum(axis=1, keepdims=True)
        error[np.arange(len(kinds)), kinds] -= 1.0
        error /= len(kinds)
        return error

    return gradient


def evaluate(
    network: ShapeNetwork, jpegs: list[CampusJpeg]
) -> dict[str, tuple[list[tuple[float, float]], list[float]]]:
    """Return for each kind the (depth in m, log odds) of plainly visible things, and log odds of false detections.

    A visible thing that is not detected has log odds of -inf.
    """
    fill = usual_fill(jpegs)
    present: dict[str, list[tuple[float, float]]] = defaultdict(list)
    false: dict[str, list[float]] = defaultdict(list)
    for data, items in jpegs:
        detected = shape_detector.find(decode(data), KINDS[1:], network)
        for item in items:
            is_plain = item.kind in KINDS and item.pixels >= PLAINLY * item.box_pixels * fill[item.kind]
            if is_plain and CHECKED_M[0] <= item.depth_m < CHECKED_M[-1]:
                odds = (d.odds for d in detected if d.kind == item.kind and _is(d, item, 0.35, 0.05))
                present[item.kind].append((item.depth_m, max(odds, default=-math.inf)))
        for d in detected:
            if not any(d.kind == item.kind and _is(d, item, 0.5, 0.1) for item in items):
                false[d.kind].append(d.odds)
    return {kind: (present[kind], false[kind]) for kind in KINDS[1:]}


def _is(detection: shape_detector.PlacedThing, item: VisibleThing, ratio_log: float, aside: float) -> bool:
    off = abs(detection.right_m / detection.depth_m - item.right_m / item.depth_m)
    return abs(math.log(detection.depth_m / item.depth_m)) < ratio_log and off < aside


def save(network: ShapeNetwork, folder: Path) -> None:
    network.save(folder / network.FILE)


def print_table(network: ShapeNetwork, jpegs: list[CampusJpeg]) -> None:
    """Print per kind how many of the near and far visible things are detected, and the false detections per picture."""
    print(f"{'':17}" + "".join(f"| {f'odds over e^{least:g}':^26} " for least in ODDS))
    print(f"{'':17}" + "| under 20 m   20–40 m   false " * len(ODDS))
    for kind, (present, false) in evaluate(network, jpegs).items():
        cells = ""
        for least in ODDS:
            near = [odds > least for depth, odds in present if depth < CHECKED_M[1]]
            far = [odds > least for depth, odds in present if depth >= CHECKED_M[1]]
            shares = (f"{sum(s)}/{len(s)}" for s in (near, far))
            cells += "| {:>10} {:>9} ".format(*shares) + f"{sum(o > least for o in false) / len(jpegs):>7.2f} "
        print(f"{kind:17}{cells}")
