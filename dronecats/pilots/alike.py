"""The things in several pictures that look alike, one of which bears an inscription that a command names."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dronecats.pilots import boards, paint, sighting
from dronecats.pilots.division import Spotted
from dronecats.pilots.inscription import Inscription
from dronecats.pilots.paint import Picture
from dronecats.pilots.referent import Referent

_ALIKE = 26.0  # boards.difference of one paint in sun and shade
DULL = ("brown",)  # a paint that bricks and tree trunks wear, too: looked for when there is no other
VIVID = tuple(color for color, band in paint.BANDS.items() if band.vivid and color not in DULL)
_ENOUGH = 0.75  # of a vehicle's score a picture, from which a paint is worn


@dataclass(frozen=True, slots=True)
class LookAlike:
    """What may be the named thing."""

    left: int  # px, as right, top and bottom
    top: int
    right: int
    bottom: int
    spot: Spotted


def sightings(pictures: Sequence[Picture], wanted: Inscription, kind: Referent) -> list[list[LookAlike]]:
    """Return for each picture the things that may carry the inscription, left to right: those of one looks.

    `kind` is the vehicle that is spoken of, by its size; what bears no plate is a board.
    """
    return _vehicles(pictures, kind) if wanted.on_plate else _boards(pictures)


def _vehicles(pictures: Sequence[Picture], kind: Referent) -> list[list[LookAlike]]:
    """Return the vehicles of the paint of which the pictures show most."""
    best: list[list[LookAlike]] = [[] for _ in pictures]
    most = 0.0
    for color in (*VIVID, *DULL):
        if color in DULL and most >= len(pictures) * _ENOUGH:
            continue
        seen = [sighting.every(picture, replace(kind, color=color)) for picture in pictures]
        score = sum(sum(sorted((s.score for s in view), reverse=True)[: len(pictures)]) for view in seen)
        if score > most:
            most = score
            best = [[_vehicle(s, p) for s in view] for view, p in zip(seen, pictures, strict=True)]
    return best


def _vehicle(seen: sighting.Sighting, picture: Picture) -> LookAlike:
    height, width = picture.shape[:2]
    left, right = (round((x + 0.5) * width) for x in (seen.box.left, seen.box.right))
    top, bottom = (round(y * width + 0.5 * height) for y in (seen.box.top, seen.box.bottom))
    aside = (seen.box.left + seen.box.right) * seen.range.depth_m  # half their sum over a focal length of a half
    return LookAlike(left, top, right, bottom, Spotted(aside, seen.range.depth_m))


def _boards(pictures: Sequence[Picture]) -> list[list[LookAlike]]:
    found = [boards.find(picture) for picture in pictures]
    every = [board for view in found for board in view]
    if not every:
        return [[] for _ in pictures]
    # those that are meant look alike, and there is one for each drone: the looks that most pictures show most of
    colors = np.array([b.color for b in every], np.float32)
    view_of = np.repeat(np.arange(len(found)), [len(view) for view in found])
    alike = [boards.difference(colors, b.color) < _ALIKE for b in every]
    counts = [np.minimum(np.bincount(view_of[near], minlength=len(found)), len(found)).sum() for near in alike]
    commonest = alike[int(np.argmax(counts))]
    color = np.median(colors[commonest], axis=0)
    like = (float(color[0]), float(color[1]), float(color[2]))
    more = [_with(view, boards.find_like(p, like)) for view, p in zip(found, pictures, strict=True)]
    return [
        [_thing(b, p.shape[1]) for b in view if boards.difference(np.array(b.color, np.float32), like) < _ALIKE]
        for view, p in zip(more, pictures, strict=True)
    ]


def _with(one: list[boards.NoticeBoard], other: list[boards.NoticeBoard]) -> list[boards.NoticeBoard]:
    """Return the boards of both lists, each once."""
    new = [b for b in other if all(b.right <= a.left or b.left >= a.right for a in one)]
    return sorted(one + new, key=lambda b: (b.middle, b.top))


def _thing(board: boards.NoticeBoard, width: int) -> LookAlike:
    aside = (board.middle - 0.5 * width) / (0.5 * width) * board.depth_m
    return LookAlike(board.left, board.top, board.right, board.bottom, Spotted(aside, board.depth_m))
