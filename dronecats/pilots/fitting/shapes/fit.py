"""The fit of the vision pilot's network: one hidden layer, cross-entropy, Adam, all in numpy."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting.shapes.examples import Examples
from dronecats.pilots.vision import shape_detector

HIDDEN = 80
BATCH = 128
RATE, DECAY = 1.5e-3, 2e-4  # of Adam's step, and of the weights (decoupled)
FIRST, SECOND = 0.9, 0.999  # of Adam's moments
HIDES, RESTS = (
    0.2,
    0.3,
)  # share of the cells that are covered, and of the hidden layer that rests: neither may be relied on
DIM = 0.25  # standard deviation by which the light of an example is scaled: halls and trees throw shadows

Floats = NDArray[np.float32]


def scales(examples: Examples) -> tuple[Floats, Floats]:
    """Return the mean of each channel and its standard deviation, (CHANNELS,) each."""
    some = examples.windows[:: max(1, len(examples.windows) // 4000)].astype(np.float32).reshape(-1, shape_detector.CHANNELS)
    return np.asarray(some.mean(axis=0), np.float32), np.asarray(some.std(axis=0), np.float32)


def mirrored(windows: Floats) -> Floats:
    """Return windows (N, rows · columns · CHANNELS) as a mirror shows them: the slanting directions change places."""
    cells = windows.reshape(-1, *shape_detector.WINDOW, shape_detector.CHANNELS)[:, :, ::-1]
    return np.ascontiguousarray(cells[..., [0, 1, 2, 3, 4, 7, 6, 5]]).reshape(windows.shape)


def fit(examples: Examples, rounds: int, seed: int) -> shape_detector.ShapeNetwork:
    """Return the network after so many rounds over the examples; equal arguments give the same network."""
    rng = np.random.default_rng((seed, 31))
    mean, spread = scales(examples)
    length = examples.windows.shape[1]
    weights = [
        rng.normal(0.0, (2.0 / length) ** 0.5, (length, HIDDEN)).astype(np.float32),
        np.zeros(HIDDEN, np.float32),
        rng.normal(0.0, (1.0 / HIDDEN) ** 0.5, (HIDDEN, len(shape_detector.KINDS))).astype(np.float32),
        np.zeros(len(shape_detector.KINDS), np.float32),
    ]
    slopes = [np.zeros_like(w) for w in weights]
    squares = [np.zeros_like(w) for w in weights]
    steps = rounds * (len(examples.kinds) // BATCH)
    for k, (x, kinds) in enumerate(_batches(examples, rounds, mean, spread, rng)):
        rate = RATE * 0.5 * (1.0 + np.cos(np.pi * k / steps)) + 1e-5
        awake = (rng.random((len(x), HIDDEN), np.float32) >= RESTS) / np.float32(1.0 - RESTS)
        for i, slope in enumerate(slopes_of(weights, x, kinds, awake)):
            slopes[i] += (1.0 - FIRST) * (slope - slopes[i])
            squares[i] += (1.0 - SECOND) * (slope * slope - squares[i])
            way = slopes[i] / (1.0 - FIRST ** (k + 1)) / (np.sqrt(squares[i] / (1.0 - SECOND ** (k + 1))) + 1e-8)
            weights[i] -= np.float32(rate) * (way + (DECAY * weights[i] if weights[i].ndim > 1 else 0.0)).astype(
                np.float32
            )
    # what was taken off the features and what they were divided by goes into the weights
    off, by = (np.tile(v, length // shape_detector.CHANNELS) for v in (mean, spread))
    hidden = weights[0] / by[:, None]
    return shape_detector.ShapeNetwork(hidden, weights[1] - off @ hidden, weights[2], weights[3])


def _batches(
    examples: Examples, rounds: int, mean: Floats, spread: Floats, rng: np.random.Generator
) -> Iterator[tuple[Floats, NDArray[np.int8]]]:
    off, by = (np.tile(v, examples.windows.shape[1] // shape_detector.CHANNELS) for v in (mean, spread))
    for _ in range(rounds):
        order = rng.permutation(len(examples.kinds))
        for k in range(len(order) // BATCH):
            take = order[k * BATCH : (k + 1) * BATCH]
            x = examples.windows[take].astype(np.float32)
            if rng.random() < 0.5:
                x = mirrored(x)
            light = np.exp(rng.normal(0.0, DIM, (len(x), 1))).astype(np.float32)
            x = x * np.minimum(light, 1.15)
            shown = rng.random((len(x), x.shape[1] // shape_detector.CHANNELS), np.float32) >= HIDES
            shown = np.repeat(shown / np.float32(1.0 - HIDES), shape_detector.CHANNELS, axis=1)
            yield (x - off) / by * shown, examples.kinds[take]


def slopes_of(
    weights: Sequence[NDArray[np.floating]],
    x: NDArray[np.floating],
    kinds: NDArray[np.int8],
    awake: NDArray[np.floating],
) -> list[NDArray[np.floating]]:
    """Return the gradient of the mean cross-entropy by each weight.

    awake: (N, hidden), 0 where a hidden unit rests, what its neighbours' weight makes up for elsewhere.
    """
    hidden, hidden_bias, out, out_bias = weights
    before = x @ hidden + hidden_bias
    active = np.maximum(before, 0.0) * awake
    raw = active @ out + out_bias
    raw -= raw.max(axis=1, keepdims=True)
    share = np.exp(raw)
    share /= share.sum(axis=1, keepdims=True)
    share[np.arange(len(kinds)), kinds] -= 1.0
    share /= len(kinds)
    back = (share @ out.T) * (before > 0.0) * awake
    return [x.T @ back, back.sum(axis=0), active.T @ share, share.sum(axis=0)]
