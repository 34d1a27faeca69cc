"""The vision pilot's eye for the catalogue's paint, made from pictures of neighbourhoods that no record has.

    python -m dronecats.pilots.fitting.sightings [--out FOLDER] [--seeds N] [--pictures N] [--rounds N]
        [--check [FOLDER]] [--short]

draws the neighbourhoods, fits the network to the patches of colour in their pictures, and writes it beside the
outlines of what it knows. `--check` only prints, of neighbourhoods that it was not fitted to, how many targets are
found, how far off its range is and how often it finds what is not there. Everything comes from seeds; the last digits
are the processor's and its algebra library's. `--short` shows in seconds that it runs, and writes only where it is
told to.
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from dronecats.pilots.fitting.sightings import examples, neighbourhoods, outlines
from dronecats.pilots.fitting.sightings.fit import fit
from dronecats.pilots.fitting.sightings.neighbourhoods import NOUNS, Target
from dronecats.pilots.vision import color_detector, color_target, pilot
from dronecats.pilots.vision.command import read_referent
from episodes.camera.renderer.renderer import Renderer
from foundation.protocol import RADIUS_M

LEARNT, UNSEEN = 320, 300  # the first seed of the neighbourhoods to learn from, and of those to check with
SEEDS, CHECKED, PICTURES, CHECKED_PICTURES, ROUNDS = 14, 4, 180, 160, 40
QUALITY = 88  # of the JPEG that a picture is kept as, as a pilot gets it
BANDS_M = (3.0, 5.0, 7.0, 10.0, 15.0, 22.0, 32.5)
ASIDE_PX = 4  # that the middle of a sighting may lie beside the target's rectangle

Kept = tuple[bytes, Target]


def draw(first: int, count: int, pictures: int) -> Iterator[Kept]:
    """Yield the pictures of `count` neighbourhoods, as JPEG, with what each asks for."""
    for seed in range(first, first + count):
        scene = neighbourhoods.build(seed)
        renderer = Renderer(scene, neighbourhoods.CAMERA, threads=1, shadow_cells=neighbourhoods.SHADOW_CELLS)
        for one in neighbourhoods.pictures(scene, renderer, seed, pictures):
            done, data = cv2.imencode(".jpg", one.rgb[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            assert done
            yield data.tobytes(), one.target
        renderer.close()


def learn(kept: Iterable[Kept], rounds: int) -> color_detector.PatchNetwork:
    """Return the network fitted to these pictures."""
    rng = np.random.default_rng(5)
    return fit(examples.joined(examples.draw(pilot.decode(data), target, rng) for data, target in kept), rounds, 1)


def write(network: color_detector.PatchNetwork, file: Path) -> None:
    """Write a network in half precision."""
    np.savez(file, **{n: getattr(network, n).astype(np.float16) for n in ("hidden", "hidden_bias", "out", "out_bias")})


@dataclass(frozen=True, slots=True)
class Found:
    """What became of one picture's instruction."""

    target: Target
    seen_m: float | None  # the range of what was taken for the target, None where nothing was
    right: bool  # it was the target


def look(kept: Iterable[Kept], network: color_detector.PatchNetwork) -> list[Found]:
    """Return what is found in the pictures."""
    found = []
    for data, target in kept:
        seen = color_detector.find(pilot.decode(data), read_referent(target.instruction), network=network)
        middle = neighbourhoods.CAMERA.width * (0.5 + 0.5 * (seen.box.left + seen.box.right)) if seen else math.nan
        right = target.box is not None and target.box[0] - ASIDE_PX <= middle <= target.box[2] + ASIDE_PX
        found.append(Found(target, seen.range.distance_m if seen else None, right))
    return found


def report(found: list[Found]) -> None:
    """Print how many targets are found and how far off their range is, by distance and by kind, and what else is."""
    groups: dict[str, list[Found]] = defaultdict(list)
    for one in found:
        if one.target.box is not None:
            for low, high in pairwise(BANDS_M):
                if low <= one.target.distance_m < high:
                    groups[f"{low:g}–{high:g} m"].append(one)
    for asset in NOUNS:
        groups[asset] = [f for f in found if f.target.asset == asset and f.target.box is not None]
    print(f"{'':12}| found   | range / truth: 10 %, half, 90 % ")
    for name, members in groups.items():
        ratios = [f.seen_m / f.target.distance_m for f in members if f.right and f.seen_m]
        spread = " ".join(f"{v:5.2f}" for v in np.percentile(ratios, (10, 50, 90))) if ratios else ""
        print(f"{name:12}| {sum(f.right for f in members):3}/{len(members):<3} | {spread}")
    there, absent = ([f for f in found if (f.target.box is None) == none] for none in (False, True))
    wrong = sum(f.seen_m is not None and not f.right for f in there)
    near = [f for f in found if f.right and f.seen_m and f.seen_m <= color_target.ARRIVED_M]
    far = sum(f.target.distance_m > RADIUS_M for f in near)
    print(f"something taken for a target that is not there: {sum(f.seen_m is not None for f in absent)}/{len(absent)}")
    print(f"something else taken for one that is: {wrong}/{len(there)}")
    print(f"judged to be within reach: {len(near)}, of which beyond the radius of success: {far}")


def main() -> None:
    """Make the network, or check one."""
    parser = argparse.ArgumentParser(description="The vision pilot's eye for the catalogue's paint.")
    shipped = Path(color_detector.__file__).parent
    parser.add_argument("--out", type=Path, help="folder to write to (default: over what ships)")
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"neighbourhoods to learn from (default {SEEDS})")
    parser.add_argument("--pictures", type=int, default=PICTURES, help=f"of each (default {PICTURES})")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"of the fit (default {ROUNDS})")
    parser.add_argument("--check", type=Path, nargs="?", const=shipped, help="only check what is in this folder")
    parser.add_argument("--short", action="store_true", help="a neighbourhood and a round, to see that it runs")
    args = parser.parse_args()
    seeds, pictures, rounds = (1, 12, 1) if args.short else (args.seeds, args.pictures, args.rounds)
    if args.check is not None:
        network = color_detector.load_network(args.check / "likeness.npz")
    else:
        network = learn(draw(LEARNT, seeds, pictures), rounds)
        out = args.out or (None if args.short else shipped)
        if out is not None:
            outlines.write(out / "outlines.npz")
            write(network, out / "likeness.npz")
            network = color_detector.load_network(out / "likeness.npz")
    report(look(draw(UNSEEN, *((1, 12) if args.short else (CHECKED, CHECKED_PICTURES))), network))


if __name__ == "__main__":
    main()
