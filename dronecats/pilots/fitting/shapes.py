"""The vision pilot's knowledge of shapes, made from pictures of campuses that do not exist.

    python -m dronecats.pilots.fitting.shapes [--out FILE] [--campuses N] [--pictures N] [--rounds N] [--check [FILE]]
        [--short]

draws the campuses, takes windows out of their pictures, fits a first network, takes windows that it mistakes, fits the
network that ships, and writes it. `--check` only prints, for a network, how many things it finds in pictures of
campuses that it was not fitted to, and how often it finds what is not there. Everything comes from seeds; the last
digits are the processor's and its algebra library's. `--short` shows in seconds that it runs, and writes only where
it is told to.
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np

from dronecats.pilots.fitting.shapes import campuses, examples
from dronecats.pilots.fitting.shapes.campuses import Shown
from dronecats.pilots.fitting.shapes.examples import Examples
from dronecats.pilots.fitting.shapes.fit import fit
from dronecats.pilots.vision import shape_detector
from dronecats.pilots.vision.colors import Picture
from episodes.camera.renderer.renderer import Renderer

LEARNT, UNSEEN = 200, 900  # the first seed of the campuses to learn from, and of those to check with
CAMPUSES, PICTURES, ROUNDS = 32, 28, 60
FIRST_CAMPUSES, FIRST_ROUNDS = 8, 14
CHECKED = (4, 24)  # campuses, and pictures of each
NOTHING, MISTAKEN = 50, 45  # windows of a picture that hold nothing: any, and those that the first network mistakes
SHADOW_CELLS = 2048  # a side of the shadow map: the half of what flights are drawn with
QUALITY = 88  # of the JPEG that a picture is kept as, as a pilot gets it
USUAL_PERCENTILE, USUAL_WITHIN_M = 85.0, 30.0
CHECKED_M = (3.2, 20.0, 40.0)
PLAINLY = 0.5  # of a thing's pixels are to be seen of what is counted as there
ODDS = (-0.9, 0.3, 1.5)  # logarithms, from which a thing counts as found

Kept = tuple[bytes, tuple[Shown, ...]]


def draw(first: int, count: int, pictures: int) -> Iterator[Kept]:
    """Yield the pictures of `count` campuses, as JPEG, with what they show."""
    for seed in range(first, first + count):
        scene = campuses.build(seed)
        renderer = Renderer(scene, campuses.CAMERA, threads=1, shadow_cells=SHADOW_CELLS)
        for one in campuses.pictures(scene, renderer, seed, pictures):
            done, data = cv2.imencode(".jpg", one.rgb[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            assert done
            yield data.tobytes(), one.shown
        renderer.close()


def decoded(kept: Iterable[Kept]) -> Iterator[tuple[Picture, tuple[Shown, ...]]]:
    """Yield pictures as a pilot decodes them."""
    for data, shown in kept:
        yield np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), np.uint8), shown


def usual(kept: Iterable[Kept]) -> dict[str, float]:
    """Return for each kind which share of the box around it a thing fills that nothing hides."""
    shares: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for _, shown in kept:
        for one in shown:
            shares[one.kind].append((one.depth_m, one.pixels / one.whole))
    return {
        kind: float(np.percentile([s for d, s in each if d < USUAL_WITHIN_M] or [s for _, s in each], USUAL_PERCENTILE))
        for kind, each in shares.items()
    }


def collect(
    kept: list[Kept], fills: dict[str, float], seed: int, others: int, network: shape_detector.ShapeNetwork | None = None
) -> Examples:
    """Return the windows of all pictures."""
    rng = np.random.default_rng((seed, 77))
    each = [examples.draw(*one, fills, rng, others, network) for one in decoded(kept)]
    return Examples(np.concatenate([e.windows for e in each]), np.concatenate([e.kinds for e in each]))


def learn(kept: list[Kept], first: int, rounds: int) -> shape_detector.ShapeNetwork:
    """Return the network fitted to these pictures, of which the `first` many make the first network."""
    fills = usual(kept)
    any_windows = collect(kept[:first], fills, 1, NOTHING)
    mistaken = collect(kept, fills, 2, MISTAKEN, fit(any_windows, FIRST_ROUNDS, 1))
    both = Examples(
        np.concatenate([any_windows.windows, mistaken.windows]), np.concatenate([any_windows.kinds, mistaken.kinds])
    )
    return fit(both, rounds, 2)


def write(network: shape_detector.ShapeNetwork, file: Path) -> None:
    """Write a network in half precision."""
    np.savez(
        file,
        hidden=network.hidden.astype(np.float16),
        hidden_bias=network.hidden_bias.astype(np.float16),
        out=network.out.astype(np.float16),
        out_bias=network.out_bias.astype(np.float16),
    )


def found(network: shape_detector.ShapeNetwork, kept: list[Kept]) -> dict[str, tuple[list[tuple[float, float]], list[float]]]:
    """Return for each kind the distance and odds of everything that is plainly there, and the odds of what is not.

    Odds are logarithms; what was not found has -inf.
    """
    fills = usual(kept)
    there: dict[str, list[tuple[float, float]]] = defaultdict(list)
    not_there: dict[str, list[float]] = defaultdict(list)
    for picture, shown in decoded(kept):
        seen = shape_detector.find(picture, shape_detector.KINDS[1:], network)
        for one in shown:
            plainly = one.kind in shape_detector.KINDS and one.pixels >= PLAINLY * one.whole * fills[one.kind]
            if plainly and CHECKED_M[0] <= one.depth_m < CHECKED_M[-1]:
                odds = (t.odds for t in seen if t.kind == one.kind and _is(t, one, 0.35, 0.05))
                there[one.kind].append((one.depth_m, max(odds, default=-math.inf)))
        for thing in seen:
            if not any(thing.kind == one.kind and _is(thing, one, 0.5, 0.1) for one in shown):
                not_there[thing.kind].append(thing.odds)
    return {kind: (there[kind], not_there[kind]) for kind in shape_detector.KINDS[1:]}


def _is(thing: shape_detector.PlacedThing, one: Shown, ratio: float, aside: float) -> bool:
    off = abs(thing.right_m / thing.depth_m - one.right_m / one.depth_m)
    return abs(math.log(thing.depth_m / one.depth_m)) < ratio and off < aside


def report(network: shape_detector.ShapeNetwork, kept: list[Kept]) -> None:
    """Print a line per kind: what is found of what is there, near and far, and what else is found, per picture."""
    print(f"{'':17}" + "".join(f"| {f'odds over e^{least:g}':^26} " for least in ODDS))
    print(f"{'':17}" + "| under 20 m   20–40 m   false " * len(ODDS))
    for kind, (there, false) in found(network, kept).items():
        cells = ""
        for least in ODDS:
            near = [odds > least for depth, odds in there if depth < CHECKED_M[1]]
            far = [odds > least for depth, odds in there if depth >= CHECKED_M[1]]
            shares = (f"{sum(s)}/{len(s)}" for s in (near, far))
            cells += "| {:>10} {:>9} ".format(*shares) + f"{sum(o > least for o in false) / len(kept):>7.2f} "
        print(f"{kind:17}{cells}")


def main() -> None:
    """Make the network, or check one."""
    parser = argparse.ArgumentParser(description="The vision pilot's network of shapes.")
    shipped = Path(shape_detector.__file__).with_name("shapes.npz")
    parser.add_argument("--out", type=Path, help="where the network is written (default: over the one that ships)")
    parser.add_argument("--campuses", type=int, default=CAMPUSES, help=f"it learns from so many (default {CAMPUSES})")
    parser.add_argument("--pictures", type=int, default=PICTURES, help=f"of each campus (default {PICTURES})")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"of the second fit (default {ROUNDS})")
    parser.add_argument("--check", type=Path, nargs="?", const=shipped, help="only check this network")
    parser.add_argument("--short", action="store_true", help="a campus and a round, to see that it runs")
    args = parser.parse_args()
    campuses_to_learn, pictures, rounds = (1, 4, 1) if args.short else (args.campuses, args.pictures, args.rounds)
    if args.check is not None:
        network = shape_detector.load_network(args.check)
    else:
        kept = list(draw(LEARNT, campuses_to_learn, pictures))
        network = learn(kept, min(FIRST_CAMPUSES, campuses_to_learn) * pictures, rounds)
        out = args.out or (None if args.short else shipped)
        if out is not None:
            write(network, out)
            network = shape_detector.load_network(out)
    report(network, list(draw(UNSEEN, *((1, 4) if args.short else CHECKED))))


if __name__ == "__main__":
    main()
