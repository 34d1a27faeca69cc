"""Fits the network of `shape_detector` to pictures of campuses that do not exist (`campuses`).

A first network is fitted to random windows of the first pictures. Then windows that it mistakes join the examples,
and the shipped network is fitted to all of them.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting import campuses, training
from dronecats.pilots.fitting.campuses import VisibleThing
from dronecats.pilots.fitting.training import BATCH, Floats, OutputGradient
from dronecats.pilots.vision import shape_detector
from dronecats.pilots.vision.colors import Picture
from dronecats.pilots.vision.shape_detector import KINDS, ShapeNetwork

FILE = "shape_network.npz"
FIT_SEED, CHECK_SEED = 200, 900  # first seed of the campuses to fit to, and of those to check with
SCENES, PICTURES, ROUNDS = 32, 28, 60
FIRST_SCENES, FIRST_ROUNDS = 8, 14  # of the first network
SHORT_PICTURES = 4
CHECK_SCENES, CHECK_PICTURES = 4, 24

# Examples. A window holds a thing near its middle: log of the distance, m aside, m of height. Another window within
# NEAR of the thing is no example. A mistaken window within PARTS of it shows a part, and is no counter-example.
HOLDS = (0.10, 0.36, 0.17)
NEAR = (0.26, 0.90, 0.40)
PARTS = (0.60, 1.6, 0.80)
WIDE_M = {"fountain": 1.8, "tiered-fountain": 1.8, "clock-tower": 1.8, "kiosk": 1.3, "bike-rack": 1.3}  # NEAR, aside
SEEN = (0.15, 0.40)  # visible share of a thing: under the first it is absent, under the second no example
NO_EXAMPLE = -1
RANDOM_WINDOWS, MISTAKEN_WINDOWS = 50, 45  # windows of a picture that hold nothing
DISPLACED_WINDOWS = 12  # windows of a picture that show a thing from a wrong place
MOST_MISTAKES = 6  # of one distance and height
USUAL_WINDOWS = 5000.0  # of a picture
USUAL_PERCENTILE, USUAL_WITHIN_M = 85.0, 30.0

HIDDEN = 80
DECAY = 2e-4  # of the weights
COVERED = 0.2  # share of the cells that are hidden in a step
DIM = 0.25  # standard deviation of the log of the light: halls and trees throw shadows

CHECKED_M = (3.2, 20.0, 40.0)
PLAINLY = 0.5  # visible share from which a thing must be detected
ODDS = (-0.9, 0.3, 1.5)  # log odds from which a thing counts as detected

CampusJpeg = tuple[bytes, tuple[VisibleThing, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class WindowExamples:
    """Windows and what they hold."""

    windows: NDArray[np.float16]  # (N, rows · columns · CHANNELS)
    kinds: NDArray[np.int8]  # (N,) index into KINDS


def join(examples: Iterable[WindowExamples]) -> WindowExamples:
    """Return all examples as one."""
    parts = list(examples)
    return WindowExamples(np.concatenate([e.windows for e in parts]), np.concatenate([e.kinds for e in parts]))


def draw(first: int, scenes: int, pictures: int) -> Iterator[CampusJpeg]:
    """Yield pictures of campuses as JPEG, each with its visible things."""
    return training.draw(campuses.build, campuses.photograph, first, scenes, pictures)


def decoded(jpegs: Iterable[CampusJpeg]) -> Iterator[tuple[Picture, tuple[VisibleThing, ...]]]:
    """Yield the pictures as a pilot decodes them."""
    for data, things in jpegs:
        yield np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), np.uint8), things


def usual_fill(jpegs: Iterable[CampusJpeg]) -> dict[str, float]:
    """Return for each kind the share of its box that an unobstructed thing fills."""
    shares: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for _, things in jpegs:
        for thing in things:
            shares[thing.kind].append((thing.depth_m, thing.pixels / thing.box_pixels))
    fill = {}
    for kind, pairs in shares.items():
        near = [share for depth, share in pairs if depth < USUAL_WITHIN_M]
        fill[kind] = float(np.percentile(near or [share for _, share in pairs], USUAL_PERCENTILE))
    return fill


def labels(
    strip: shape_detector.Strip,
    height: int,
    things: Iterable[VisibleThing],
    fill: dict[str, float],
    near: tuple[float, float, float] = NEAR,
) -> NDArray[np.int8]:
    """Return for each window of a strip the index of its kind, 0 for nothing, or NO_EXAMPLE."""
    right = strip.rights_m()
    kinds = np.zeros(len(right), np.int8)
    offsets = np.full(len(right), np.inf)
    for thing in things:
        if thing.kind not in KINDS:
            continue
        share = thing.pixels / (thing.box_pixels * fill[thing.kind])
        # at another distance the same direction is farther aside, and the same row farther below
        depth_off = abs(np.log(thing.depth_m / strip.depth_m))
        aside = np.abs(right - thing.right_m * strip.depth_m / thing.depth_m)
        height_off = abs(thing.below_m - shape_detector.HEIGHTS_M[height])
        if share < SEEN[0] or depth_off > near[0] or height_off > near[2]:
            continue
        is_near = aside < max(WIDE_M.get(thing.kind, 0.0), near[1])
        is_example = depth_off < HOLDS[0] and height_off < HOLDS[2] and share >= SEEN[1]
        holds = aside < HOLDS[1] if is_example else np.zeros_like(is_near)
        offset = depth_off / HOLDS[0] + aside / HOLDS[1] + height_off / HOLDS[2]
        kinds[is_near & ~holds & (kinds == 0)] = NO_EXAMPLE
        better = holds & (offset < offsets)
        kinds[better] = KINDS.index(thing.kind)
        offsets[better] = offset[better]
    return kinds


def examples_of(
    picture: Picture,
    things: tuple[VisibleThing, ...],
    fill: dict[str, float],
    rng: np.random.Generator,
    empty_windows: int,
    network: ShapeNetwork | None = None,
) -> WindowExamples:
    """Return windows of one picture: all that hold a thing, and `empty_windows` that hold nothing.

    With a network, the empty ones are those that it mistakes most, and DISPLACED_WINDOWS join them.
    """
    windows, kinds = list[NDArray[np.float16]](), list[NDArray[np.int8]]()
    empty, rank, displaced = list[NDArray[np.float16]](), list[NDArray[np.float64]](), list[NDArray[np.float16]]()
    for strip in shape_detector.strips(picture):
        for height in range(len(shape_detector.HEIGHTS_M)):
            window_kinds = labels(strip, height, things, fill)
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
            is_part = labels(strip, height, things, fill, PARTS)[nothing] != 0
            displaced.append(seen[rng.permutation(nothing[is_part])[:1]].astype(np.float16))
            clear = nothing[~is_part]
            mistake = 1.0 - network.probabilities(seen[clear])[:, 0]
            worst = np.argsort(-mistake)[:MOST_MISTAKES]
            empty.append(seen[clear[worst]].astype(np.float16))
            rank.append(-mistake[worst].astype(np.float64))
    chosen = np.concatenate(empty)[np.argsort(np.concatenate(rank), kind="stable")[:empty_windows]]
    beside = rng.permutation(np.concatenate(displaced))[:DISPLACED_WINDOWS] if displaced else chosen[:0]
    none = np.concatenate((chosen, beside))
    return WindowExamples(np.concatenate((*windows, none)), np.concatenate((*kinds, np.zeros(len(none), np.int8))))


def collect(
    jpegs: list[CampusJpeg], fill: dict[str, float], seed: int, empty: int, network: ShapeNetwork | None = None
) -> WindowExamples:
    """Return the examples of all pictures."""
    rng = np.random.default_rng((seed, 77))
    return join(examples_of(*picture, fill, rng, empty, network) for picture in decoded(jpegs))


def fit_scenes(scenes: int, pictures: int, rounds: int) -> ShapeNetwork:
    """Return the network fitted to so many pictures of so many campuses."""
    jpegs = list(draw(FIT_SEED, scenes, pictures))
    fill = usual_fill(jpegs)
    random = collect(jpegs[: min(FIRST_SCENES, scenes) * pictures], fill, 1, RANDOM_WINDOWS)
    mistaken = collect(jpegs, fill, 2, MISTAKEN_WINDOWS, fit(random, FIRST_ROUNDS, 1))
    return fit(join((random, mistaken)), rounds, 2)


def fit(examples: WindowExamples, rounds: int, seed: int) -> ShapeNetwork:
    """Return the network after so many rounds over the examples; equal arguments give the same network."""
    rng = np.random.default_rng((seed, 31))
    cells = examples.windows[:: max(1, len(examples.windows) // 4000)].astype(np.float32)
    channels = cells.reshape(-1, shape_detector.CHANNELS)
    length = examples.windows.shape[1]
    repeats = length // shape_detector.CHANNELS
    mean = np.tile(np.asarray(channels.mean(axis=0), np.float32), repeats)
    deviation = np.tile(np.asarray(channels.std(axis=0), np.float32), repeats)
    weights = training.initial_weights(rng, length, HIDDEN, len(KINDS))
    steps = rounds * (len(examples.kinds) // BATCH)
    training.train(weights, _batches(examples, rounds, mean, deviation, rng), steps, DECAY, rng)
    # the network takes raw features: their mean and deviation go into the weights
    hidden = weights[0] / deviation[:, None]
    return ShapeNetwork(hidden, weights[1] - mean @ hidden, weights[2], weights[3])


def mirrored(windows: Floats) -> Floats:
    """Return windows (N, rows · columns · CHANNELS) as a mirror shows them: the two diagonal directions swap."""
    cells = windows.reshape(-1, *shape_detector.WINDOW, shape_detector.CHANNELS)[:, :, ::-1]
    return np.ascontiguousarray(cells[..., [0, 1, 2, 3, 4, 7, 6, 5]]).reshape(windows.shape)


def _batches(
    examples: WindowExamples, rounds: int, mean: Floats, deviation: Floats, rng: np.random.Generator
) -> Iterator[tuple[Floats, OutputGradient]]:
    for _ in range(rounds):
        order = rng.permutation(len(examples.kinds))
        for k in range(len(order) // BATCH):
            take = order[k * BATCH : (k + 1) * BATCH]
            x = examples.windows[take].astype(np.float32)
            if rng.random() < 0.5:
                x = mirrored(x)
            light = np.exp(rng.normal(0.0, DIM, (len(x), 1))).astype(np.float32)
            x = x * np.minimum(light, 1.15)
            visible = rng.random((len(x), x.shape[1] // shape_detector.CHANNELS), np.float32) >= COVERED
            factor = np.repeat(visible / np.float32(1.0 - COVERED), shape_detector.CHANNELS, axis=1)
            yield np.asarray((x - mean) / deviation * factor, np.float32), cross_entropy_gradient(examples.kinds[take])


def cross_entropy_gradient(kinds: NDArray[np.int8]) -> OutputGradient:
    """Return the gradient of the mean cross-entropy by the network's outputs."""

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
    """Return for each kind the (distance, log odds) of every plainly visible thing, and the log odds of false ones.

    A visible thing that is not detected has -inf.
    """
    fill = usual_fill(jpegs)
    present: dict[str, list[tuple[float, float]]] = defaultdict(list)
    false: dict[str, list[float]] = defaultdict(list)
    for picture, things in decoded(jpegs):
        detected = shape_detector.find(picture, KINDS[1:], network)
        for thing in things:
            is_plain = thing.kind in KINDS and thing.pixels >= PLAINLY * thing.box_pixels * fill[thing.kind]
            if is_plain and CHECKED_M[0] <= thing.depth_m < CHECKED_M[-1]:
                odds = (d.odds for d in detected if d.kind == thing.kind and _is(d, thing, 0.35, 0.05))
                present[thing.kind].append((thing.depth_m, max(odds, default=-math.inf)))
        for d in detected:
            if not any(d.kind == thing.kind and _is(d, thing, 0.5, 0.1) for thing in things):
                false[d.kind].append(d.odds)
    return {kind: (present[kind], false[kind]) for kind in KINDS[1:]}


def _is(detection: shape_detector.PlacedThing, thing: VisibleThing, ratio_log: float, aside: float) -> bool:
    off = abs(detection.right_m / detection.depth_m - thing.right_m / thing.depth_m)
    return abs(math.log(detection.depth_m / thing.depth_m)) < ratio_log and off < aside


def check(folder: Path, short: bool) -> None:
    """Print a line per kind: detected of visible things, near and far, and false detections per picture."""
    jpegs = list(draw(CHECK_SEED, *((1, SHORT_PICTURES) if short else (CHECK_SCENES, CHECK_PICTURES))))
    _print_table(shape_detector.load_network(folder / FILE), jpegs)


def fit_and_check(scenes: int, pictures: int, rounds: int, out: Path | None, short: bool) -> None:
    """Fit a network, write it to a folder if there is one, and print how it does."""
    network = fit_scenes(scenes, pictures, rounds)
    if out is not None:
        training.save_network(network, out / FILE)
        check(out, short)
        return
    _print_table(network, list(draw(CHECK_SEED, 1, SHORT_PICTURES)))


def _print_table(network: ShapeNetwork, jpegs: list[CampusJpeg]) -> None:
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
