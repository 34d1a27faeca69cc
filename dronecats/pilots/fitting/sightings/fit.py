"""The fit of the vision pilot's eye for paint: one hidden layer, Adam, all in numpy."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting.sightings.examples import Examples
from dronecats.pilots.vision import color_detector

HIDDEN = 48
BATCH = 128
RATE, DECAY = 1.5e-3, 4e-4  # of Adam's step, and of the weights (decoupled)
FIRST, SECOND = 0.9, 0.999  # of Adam's moments
HIDES, RESTS = 0.15, 0.3  # share of the cells that are covered, and of the hidden layer that rests
DIM = 0.2  # standard deviation by which the light of an example is scaled
FACTOR = 2.0  # weight of a distance's squared error beside the cross-entropy
SPREAD = 0.15  # of the logarithm of a distance, which counts as one

Floats = NDArray[np.float32]
_CELLS = color_detector.SIDE * color_detector.SIDE
_PATCH = _CELLS * color_detector.CHANNELS


def mirrored(seen: Floats) -> Floats:
    """Return examples (N, LENGTH) as a mirror shows them."""
    patch = seen[:, :_PATCH].reshape(-1, color_detector.SIDE, color_detector.SIDE, color_detector.CHANNELS)[:, :, ::-1]
    rest = seen[:, _PATCH:].copy()
    rest[:, [0, 1]] = -rest[:, [1, 0]]  # the rectangle's left and right
    rest[:, [9, 10]] = rest[:, [10, 9]]  # and whether each is at the picture's edge
    return np.concatenate((patch.reshape(len(seen), _PATCH), rest), axis=1)


def fit(examples: Examples, rounds: int, seed: int) -> color_detector.PatchNetwork:
    """Return the network after so many rounds over the examples; equal arguments give the same network."""
    rng = np.random.default_rng((seed, 32))
    some = examples.seen[:: max(1, len(examples.seen) // 6000)].astype(np.float32)
    off, by = some.mean(axis=0), np.maximum(some.std(axis=0), 0.05)
    weights = [
        rng.normal(0.0, (2.0 / color_detector.LENGTH) ** 0.5, (color_detector.LENGTH, HIDDEN)).astype(np.float32),
        np.zeros(HIDDEN, np.float32),
        rng.normal(0.0, (1.0 / HIDDEN) ** 0.5, (HIDDEN, 2)).astype(np.float32),
        np.zeros(2, np.float32),
    ]
    slopes, squares = [np.zeros_like(w) for w in weights], [np.zeros_like(w) for w in weights]
    steps = rounds * (len(examples.there) // BATCH)
    for k, (x, there, factor) in enumerate(_batches(examples, rounds, off, by, rng)):
        rate = np.float32(RATE * 0.5 * (1.0 + np.cos(np.pi * k / steps)) + 1e-5)
        awake = (rng.random((len(x), HIDDEN), np.float32) >= RESTS) / np.float32(1.0 - RESTS)
        for i, slope in enumerate(slopes_of(weights, x, there, factor, awake)):
            slopes[i] += (1.0 - FIRST) * (slope - slopes[i])
            squares[i] += (1.0 - SECOND) * (slope * slope - squares[i])
            way = slopes[i] / (1.0 - FIRST ** (k + 1)) / (np.sqrt(squares[i] / (1.0 - SECOND ** (k + 1))) + 1e-8)
            weights[i] -= rate * (way + (DECAY * weights[i] if weights[i].ndim > 1 else 0.0)).astype(np.float32)
    # what was taken off the examples and what they were divided by goes into the weights
    hidden = weights[0] / by[:, None]
    out = weights[2] * np.array((1.0, SPREAD), np.float32)
    return color_detector.PatchNetwork(
        hidden, weights[1] - off @ hidden, out, weights[3] * np.array((1.0, SPREAD), np.float32)
    )


def _batches(
    examples: Examples, rounds: int, off: Floats, by: Floats, rng: np.random.Generator
) -> Iterator[tuple[Floats, Floats, Floats]]:
    yes = np.flatnonzero(examples.there > 0.5)
    no = np.flatnonzero(examples.there < 0.5)
    for _ in range(rounds):
        # as many that are the target as are not, about: the rarer ones are taken again
        order = rng.permutation(np.concatenate((no, rng.choice(yes, max(1, len(no) // 2)))))[: len(examples.there)]
        for k in range(len(order) // BATCH):
            take = order[k * BATCH : (k + 1) * BATCH]
            x = examples.seen[take].astype(np.float32)
            if rng.random() < 0.5:
                x = mirrored(x)
            patch = x[:, :_PATCH].reshape(len(x), _CELLS, color_detector.CHANNELS)
            patch[:, :, :3] *= np.minimum(np.exp(rng.normal(0.0, DIM, (len(x), 1, 1))), 1.15).astype(np.float32)
            x = (np.concatenate((patch.reshape(len(x), _PATCH), x[:, _PATCH:]), axis=1) - off) / by
            shown = (rng.random((len(x), _CELLS), np.float32) >= HIDES) / np.float32(1.0 - HIDES)
            x[:, :_PATCH] *= np.repeat(shown, color_detector.CHANNELS, axis=1)
            yield x, examples.there[take], examples.factor[take]


def slopes_of(
    weights: Sequence[NDArray[np.floating]],
    x: NDArray[np.floating],
    there: NDArray[np.floating],
    factor: NDArray[np.floating],
    awake: NDArray[np.floating],
) -> list[NDArray[np.floating]]:
    """Return the gradient of the mean cost by each weight: cross-entropy, and of the targets the error of the range.

    awake: (N, hidden), 0 where a hidden unit rests.
    """
    hidden, hidden_bias, out, out_bias = weights
    before = x @ hidden + hidden_bias
    active = np.maximum(before, 0.0) * awake
    raw = active @ out + out_bias
    wrong = np.empty_like(raw)
    wrong[:, 0] = 1.0 / (1.0 + np.exp(-np.clip(raw[:, 0], -30.0, 30.0))) - there
    # an error beyond three of SPREAD counts as three: what is hidden in part has the wrong size, whatever is done
    wrong[:, 1] = there * 0.1 * FACTOR * np.clip(raw[:, 1] - factor / SPREAD, -3.0, 3.0)
    wrong /= len(there)
    back = (wrong @ out.T) * (before > 0.0) * awake
    return [x.T @ back, back.sum(axis=0), active.T @ wrong, wrong.sum(axis=0)]
