"""Fits the network to mirrored and shifted batches, with one loss for all its outputs, and evaluates it."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from examples.action_head.dataset import Decisions
from examples.action_head.features import KINDS, WIDTH
from examples.action_head.network import ActionHead
from examples.action_head.pilot import COLUMNS, FARTHEST_M, NEAREST_M, ROWS, TURNS_DEG, point
from examples.action_head.settings import Shape, Training
from foundation.protocol import FINISHED, GO, ROTATE

_CELL_PX = WIDTH // COLUMNS
_SHIFT_CELLS = (9, 2)  # largest shift of a picture: horizontal, vertical
_MISNAMED = 0.15  # share of pictures with the words of another flight, whose target they do not show
_HISTORY_DROPOUT = 0.3  # share of decisions whose history is set to zero
_SPREAD_CELLS = 0.7  # σ of the Gaussian around the point in the wanted heat map
_WEIGHTS = {GO: 1.0, ROTATE: 1.5, FINISHED: 2.0}  # loss weights; rare actions weigh more; a think counts 0
_WARM = 0.1  # share of steps in which the learning rate rises


@dataclass(frozen=True, slots=True)
class Batch:
    """Decisions as tensors. Some are mirrored, shifted or misnamed (with the words of another flight)."""

    pictures: Tensor  # uint8 (n, 3, HEIGHT, WIDTH)
    words: Tensor  # (n, WORDS)
    past: Tensor  # (n, PAST)
    kinds: Tensor  # int64 (n,)
    points: Tensor  # (n, 2), 0 … 1; outside this range if the shift moves the point out of the picture
    depths_m: Tensor  # (n,)
    angles_deg: Tensor  # (n,); not valid for a misnamed decision
    named: Tensor  # bool (n,), whether the words are the flight's own


@dataclass(frozen=True, slots=True)
class HeldOutResult:
    """The results of a network on held-out decisions."""

    decisions: int
    right_kind: float  # share of decisions with the right action
    point_error: float  # median horizontal error of a go's point, as a fraction of the picture's width
    depth_factor: float  # median factor (≥ 1) between a go's depth and the right depth
    declares_at: float  # least probability of `finished` at which the head declares arrival; gives the highest F1
    declared: float  # recall at this threshold: share of the arrivals that are declared
    precise: float  # precision at this threshold: share of the declarations that are arrivals


def fit(data: Decisions, shape: Shape, training: Training, report: Callable[[int, float], None]) -> ActionHead:
    """Return a network fitted to the decisions that are not held out.

    `report` is called with the number and mean loss of each epoch. The same data, shape and training give the same
    weights on the same machine.
    """
    torch.set_num_threads(training.threads)
    torch.manual_seed(training.seed)
    torch.use_deterministic_algorithms(True)
    numbers = np.random.default_rng(training.seed)
    head = ActionHead(shape)
    learnable = np.flatnonzero(~data.held_out)
    fitter = torch.optim.AdamW(head.parameters(), lr=training.rate, weight_decay=training.decay)
    steps = training.epochs * math.ceil(len(learnable) / training.batch)
    rates = torch.optim.lr_scheduler.OneCycleLR(fitter, training.rate, total_steps=steps, pct_start=_WARM)
    for epoch in range(training.epochs):
        head.train()
        losses = []
        for chosen in _shuffled(learnable, training.batch, numbers):
            loss = loss_of(head, drawn(data, chosen, numbers))
            fitter.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(head.parameters(), 1.0)
            fitter.step()
            rates.step()
            losses.append(float(loss.detach()))
        report(epoch, float(np.mean(losses)))
    return head


def _shuffled(learnt: NDArray[np.int64], size: int, numbers: np.random.Generator) -> Iterator[NDArray[np.int64]]:
    order = numbers.permutation(learnt)
    for first in range(0, len(order), size):
        yield order[first : first + size]


def drawn(data: Decisions, chosen: NDArray[np.int64], numbers: np.random.Generator) -> Batch:
    """Return the chosen decisions as a batch, mirrored, shifted and misnamed at random.

    A misnamed picture does not show the target that its words name, so the right action is a rotate.
    """
    mirrored = numbers.random(len(chosen)) < 0.5
    side = mirrored.astype(int)
    pictures = data.pictures[chosen]
    pictures[mirrored] = pictures[mirrored][..., ::-1]
    points, sign = data.points[chosen], np.where(mirrored, -1.0, 1.0).astype(np.float32)
    points = np.stack([np.where(mirrored, 1.0 - points[:, 0], points[:, 0]), points[:, 1]], 1)
    cells = np.stack([numbers.integers(-most, most + 1, len(chosen)) for most in _SHIFT_CELLS], 1)
    shifts = (cells * _CELL_PX).tolist()
    shown = [moved(torch.from_numpy(picture), *shift) for picture, shift in zip(pictures, shifts, strict=True)]
    words, kinds = data.words[side, chosen], data.kinds[chosen]
    shuffled = numbers.permutation(chosen)
    misnamed = (numbers.random(len(chosen)) < _MISNAMED) & (data.words[0, shuffled] != data.words[0, chosen]).any(1)
    words[misnamed], kinds[misnamed] = data.words[0, shuffled[misnamed]], KINDS.index(ROTATE)
    past = data.past[side, chosen] * (numbers.random((len(chosen), 1)) >= _HISTORY_DROPOUT)
    return Batch(
        pictures=torch.stack(shown),
        words=torch.from_numpy(words),
        past=torch.from_numpy(past.astype(np.float32)),
        kinds=torch.from_numpy(kinds),
        points=torch.from_numpy(points + (cells / (COLUMNS, ROWS)).astype(np.float32)),
        depths_m=torch.from_numpy(data.depths_m[chosen]),
        angles_deg=torch.from_numpy(data.angles_deg[chosen] * sign),
        named=torch.from_numpy(~misnamed),
    )


def moved(picture: Tensor, right_px: int, down_px: int) -> Tensor:
    """Return a picture (3, h, w) shifted by some pixels. The uncovered area repeats the picture's edge."""
    height, width = picture.shape[1:]
    rows = (torch.arange(height) - down_px).clamp(0, height - 1)
    columns = (torch.arange(width) - right_px).clamp(0, width - 1)
    return picture[:, rows][:, :, columns]


def loss_of(head: ActionHead, batch: Batch) -> Tensor:
    """Return the loss of a batch: the loss of the kind, and the loss of each number that the action has.

    A go whose point is outside the shifted picture does not count.
    """
    kinds, heat, depth, turns = head(batch.pictures, batch.words, batch.past)
    inside = ((batch.points >= 0.0) & (batch.points < 1.0)).all(1)
    go = (batch.kinds == KINDS.index(GO)) & inside
    counted = go | (batch.kinds != KINDS.index(GO))
    weights = torch.tensor([_WEIGHTS.get(kind, 0.0) for kind in KINDS])
    loss = kinds.sum() * 0.0
    if counted.any():
        loss = functional.cross_entropy(kinds[counted], batch.kinds[counted], weights)
    if go.any():
        wanted = _cells(batch.points[go])
        loss = loss + functional.cross_entropy(heat[go], wanted)
        loss = loss + 2.0 * functional.smooth_l1_loss(depth[go], batch.depths_m[go].clamp(NEAREST_M, FARTHEST_M).log())
    turning = (batch.kinds == KINDS.index(ROTATE)) & batch.named
    if turning.any():
        apart = (batch.angles_deg[turning][:, None] - torch.tensor(TURNS_DEG)).abs()
        loss = loss + 0.3 * functional.cross_entropy(turns[turning], apart.argmin(1))
    return loss


def _cells(points: Tensor) -> Tensor:
    """Return the wanted heat maps (n, ROWS · COLUMNS) of points (n, 2): a Gaussian around each point, of sum 1."""
    x = (torch.arange(COLUMNS) + 0.5)[None, None, :] - points[:, 0, None, None] * COLUMNS
    y = (torch.arange(ROWS) + 0.5)[None, :, None] - points[:, 1, None, None] * ROWS
    bell = torch.exp(-(x**2 + y**2) / (2.0 * _SPREAD_CELLS**2)).flatten(1)
    return bell / bell.sum(1, keepdim=True)


def judged(head: ActionHead, data: Decisions) -> HeldOutResult | None:
    """Return a network's results on held-out decisions; None if none of them is an arrival (action `finished`)."""
    kept = np.flatnonzero(data.held_out)
    finished = data.kinds[kept] == KINDS.index(FINISHED)
    if not finished.any():
        return None
    outlooks = [head.outlook(data.pictures[k], data.words[0, k], data.past[0, k]) for k in kept]
    chance = np.array([outlook.kinds[KINDS.index(FINISHED)] for outlook in outlooks])
    declares_at = threshold(chance, finished)
    claims = chance >= declares_at
    chosen = np.array([outlook.kinds.argmax() for outlook in outlooks])
    gos = [k for k, place in enumerate(kept) if data.kinds[place] == KINDS.index(GO)]
    off = [abs(point(outlooks[k].heat)[0] - float(data.points[kept[k], 0])) for k in gos]
    factors = [abs(math.log(outlooks[k].depth_m / max(float(data.depths_m[kept[k]]), NEAREST_M))) for k in gos]
    return HeldOutResult(
        decisions=len(kept),
        right_kind=float((chosen == data.kinds[kept]).mean()),
        point_error=float(np.median(off)) if off else math.nan,
        depth_factor=float(np.exp(np.median(factors))) if factors else math.nan,
        declares_at=declares_at,
        declared=float(claims[finished].mean()),
        precise=float(finished[claims].mean()) if claims.any() else 0.0,
    )


def threshold(chance: NDArray[np.float64], arrived: NDArray[np.bool_]) -> float:
    """Return the threshold on `chance` with the highest F1 of declarations; the middle one if several are equal."""
    tried = np.linspace(0.05, 0.95, 19)
    scores = []
    for least in tried:
        claims = chance >= least
        true = float((claims & arrived).sum())
        scores.append(2.0 * true / max(float(claims.sum() + arrived.sum()), 1.0))
    best = np.flatnonzero(np.isclose(scores, max(scores)))
    return round(float(tried[best[len(best) // 2]]), 2)
