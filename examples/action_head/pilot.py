"""The pilot that uses a trained head. It turns a request into the text of a reply, and does not import PyTorch.

Two rules are not learnt, because no flight in the data shows their cases. The pilot never declares arrival (`finished`)
twice in a row. After five turns or thinks in a row, it flies to another place instead of turning again.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots import actions
from dronecats.pilots.actions import PastAction, Pilot
from examples.action_head import features
from examples.action_head.features import KINDS
from foundation.errors import UsageError
from foundation.protocol import FINISHED, GO, HISTORY_LENGTH, POINT_SPAN, ROTATE, THINK

COLUMNS, ROWS = 32, 18  # size of the heat map of the point; a cell covers 8 × 8 px of the input picture
TURNS_DEG = tuple(float(angle) for angle in range(-90, 91, 15))
ELSEWHERE_M = 6.0  # m, depth of the go to another place; the agent shortens a go with a depth below 5 m
NEAREST_M, FARTHEST_M = 0.5, 60.0  # limits of a go's depth
_AROUND = 1  # cells on each side of the highest cell; the point is the weighted mean of these cells


@dataclass(frozen=True, slots=True)
class Outlook:
    """The network's outputs for one picture."""

    kinds: NDArray[np.float32]  # (4,), probabilities of the actions, in the order of KINDS
    heat: NDArray[np.float32]  # (ROWS, COLUMNS), the probability that the point is in each cell
    depth_m: float  # m, used only if the action is a go
    turns: NDArray[np.float32]  # (len(TURNS_DEG),), probabilities of the angles in TURNS_DEG


def point(heat: NDArray[np.float32]) -> tuple[float, float]:
    """Return the point of a heat map, x and y 0 … 1: the weighted mean around its highest cell."""
    row, column = np.unravel_index(int(heat.argmax()), heat.shape)
    rows = slice(max(0, int(row) - _AROUND), int(row) + _AROUND + 1)
    columns = slice(max(0, int(column) - _AROUND), int(column) + _AROUND + 1)
    near = heat[rows, columns].astype(np.float64)
    near /= max(near.sum(), 1e-12)
    y = (near.sum(1) * (np.arange(heat.shape[0])[rows] + 0.5)).sum() / heat.shape[0]
    x = (near.sum(0) * (np.arange(heat.shape[1])[columns] + 0.5)).sum() / heat.shape[1]
    return float(x), float(y)


def decide(seen: Outlook, past: Sequence[PastAction], declares_at: float) -> str:
    """Return one drone's reply, which declares arrival if the probability of `finished` is at least `declares_at`."""
    chance = dict(zip(KINDS, seen.kinds.tolist(), strict=True))
    in_vain = bool(past) and past[-1].kind == FINISHED
    if chance[FINISHED] >= declares_at and not in_vain:
        return actions.finished()
    x, y = point(seen.heat)
    depth_m = min(max(seen.depth_m, NEAREST_M), FARTHEST_M)
    if chance[GO] >= chance[ROTATE]:
        return actions.go(POINT_SPAN * x, POINT_SPAN * y, depth_m)
    if len(past) == HISTORY_LENGTH and all(action.kind in (ROTATE, THINK) for action in past):
        return actions.go(POINT_SPAN / 2.0, POINT_SPAN / 2.0, ELSEWHERE_M)
    return actions.rotate(TURNS_DEG[int(seen.turns.argmax())])


# a network: from one picture, an instruction's words and the last actions to the outputs
Network = Callable[[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32]], Outlook]


def pilot(network: Network, declares_at: float) -> Pilot:
    """Return the pilot that a server serves. It has no memory, and evaluates one picture at a time.

    Each drone of a fleet is handled as if it were alone. The pilot raises UsageError for a request without a picture.
    """
    turn = threading.Lock()

    def answer(prompt: str, pictures: list[bytes]) -> str:
        if not pictures:
            raise UsageError("The head needs a picture of each drone.")
        request = actions.read_prompt(prompt)
        words = features.words(request.command)
        replies = []
        for drone, jpeg in enumerate(pictures):
            past = request.past(drone)
            with turn:
                seen = network(features.picture(jpeg), words, features.history(past))
            replies.append(decide(seen, past, declares_at))
        return actions.join(replies)

    return answer
