"""The things in several pictures that look alike, one of which bears an inscription that a command names."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dronecats.pilots.vision import boards, paint, sighting
from dronecats.pilots.vision.division import Spotted
from dronecats.pilots.vision.inscription import Inscription
from dronecats.pilots.vision.paint import Picture
from dronecats.pilots.vision.referent import Referent

_ALIKE = 26.0  # boards.difference of one paint in sun and shade
DULL = ("brown",)  # a paint that bricks and tree trunks wear, too: looked for when there is no other
VIVID = tuple(color for color, band in paint.BANDS.items() if band.vivid and color not in DULL)
_LOOK_ALIKES = 4  # as many as there usually are; more of one looks in a picture count no more
_ENOUGH = 0.75  # of a vehicle's score a picture, from which a paint is worn


@dataclass(frozen=True, slots=True)
class LookAlike:
    """What may be the named thing."""

    left: int  # px, as right, top and bottom
    top: int
    right: int
    bottom: int
    spot: Spotted
    score: float = 1.0  # 0 … 1: how well it looks like one

    @property
    def size_px(self) -> float:
        """px, the side of a square as large as its rectangle."""
        return math.sqrt((self.right - self.left) * (self.bottom - self.top))


Own = Callable[[int, Sequence[LookAlike]], LookAlike | None]  # the thing that a drone was sent to, of those it sees


def sightings(
    pictures: Sequence[Picture], wanted: Inscription, kind: Referent, own: Own | None = None
) -> list[list[LookAlike]]:
    """Return for each picture the things that may carry the inscription, left to right: those of one looks.

    `kind` is the vehicle that is spoken of, by its size; what bears no plate is a board. Once the drones are under way,
    `own` tells the paint: it is the one of which each still sees its own.
    """
    return _vehicles(pictures, kind, own) if wanted.on_plate else _boards(pictures)


def _vehicles(pictures: Sequence[Picture], kind: Referent, own: Own | None) -> list[list[LookAlike]]:
    """Return the vehicles of the paint of which the pictures show most, or most of the drones their own."""
    best: list[list[LookAlike]] = [[] for _ in pictures]
    most = (0.0, 0.0)
    for color in (*VIVID, *DULL):
        if color in DULL and most[1] >= len(pictures) * _ENOUGH:
            continue
        views = [[_vehicle(s, p) for s in sighting.every(p, replace(kind, color=color))] for p in pictures]
        mine = [own(k, view) for k, view in enumerate(views)] if own else []
        worth = (
            sum(one.score * one.size_px for one in mine if one),  # near, a vehicle is larger than any brick of its hue
            sum(sum(sorted((one.score for one in view), reverse=True)[:_LOOK_ALIKES]) for view in views),
        )
        if worth > most:
            most, best = worth, views
    return best


def _vehicle(seen: sighting.Sighting, picture: Picture) -> LookAlike:
    height, width = picture.shape[:2]
    left, right = (round((x + 0.5) * width) for x in (seen.box.left, seen.box.right))
    top, bottom = (round(y * width + 0.5 * height) for y in (seen.box.top, seen.box.bottom))
    aside = (seen.box.left + seen.box.right) * seen.range.depth_m  # half their sum over a focal length of a half
    return LookAlike(left, top, right, bottom, Spotted(aside, seen.range.depth_m), seen.score)


def _boards(pictures: Sequence[Picture]) -> list[list[LookAlike]]:
    found = [boards.find(picture) for picture in pictures]
    every = [board for view in found for board in view]
    if not every:
        return [[] for _ in pictures]
    # those that are meant look alike, and there is one for each drone: the looks that most pictures show most of
    colors = np.array([b.color for b in every], np.float32)
    view_of = np.repeat(np.arange(len(found)), [len(view) for view in found])
    alike = [boards.difference(colors, b.color) < _ALIKE for b in every]
    counts = [np.minimum(np.bincount(view_of[near], minlength=len(found)), _LOOK_ALIKES).sum() for near in alike]
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
