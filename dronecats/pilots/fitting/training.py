"""Renders training pictures and trains the two vision networks with Adam in numpy.

A network has one hidden layer of rectified linear units. Its weights are a list: hidden (inputs, H), hidden bias (H,),
out (H, outputs), and out bias (outputs,).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.renderer import Renderer
from episodes.maps.scene import Scene
from foundation.camera import CameraModel

CAMERA = CameraModel(640, 360)
JPEG_QUALITY = 88  # of training pictures; pictures of flights have 85 (`foundation.camera.QUALITY`)
SHADOW_CELLS = 2048  # cells per side of the shadow map; flights have twice as many
BATCH = 128  # examples per step
RATE = 1.5e-3  # learning rate at the beginning
FIRST, SECOND = 0.9, 0.999  # decay rates of Adam's moments
DROPOUT = 0.3  # probability that a hidden unit is off for an example

Floats = NDArray[np.float32]
Truth = TypeVar("Truth")
OutputGradient = Callable[[NDArray[np.floating]], NDArray[np.floating]]  # outputs → gradient of the mean cost, (N, K)


def draw(
    build: Callable[[int], Scene],
    photograph: Callable[[Scene, Renderer, int, int], Iterator[tuple[NDArray[np.uint8], Truth]]],
    first: int,
    scenes: int,
    pictures: int,
) -> Iterator[tuple[bytes, Truth]]:
    """Yield JPEGs with the truth from `photograph`: `pictures` per scene, for the `scenes` seeds from `first` on."""
    for seed in range(first, first + scenes):
        scene = build(seed)
        renderer = Renderer(scene, CAMERA, threads=1, shadow_cells=SHADOW_CELLS)
        for rgb, truth in photograph(scene, renderer, seed, pictures):
            done, data = cv2.imencode(".jpg", rgb[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            assert done
            yield data.tobytes(), truth
        renderer.close()


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Inputs of a network, and what they show."""

    inputs: NDArray[np.float16]  # (N, inputs)
    labels: NDArray[Any]  # (N,) or (N, labels)

    @classmethod
    def join(cls, examples: Iterable["Examples"]) -> "Examples":
        batches = list(examples)
        return cls(np.concatenate([e.inputs for e in batches]), np.concatenate([e.labels for e in batches]))


def batches(
    examples: Examples,
    orders: Iterable[NDArray[np.int64]],
    mirrored: Callable[[Floats], Floats],
    rng: np.random.Generator,
) -> Iterator[tuple[Floats, NDArray[Any]]]:
    """Yield the inputs and labels of BATCH examples; half of the batches are mirrored. `orders`: one for each round."""
    for order in orders:
        for k in range(len(order) // BATCH):
            take = order[k * BATCH : (k + 1) * BATCH]
            x = examples.inputs[take].astype(np.float32)
            yield mirrored(x) if rng.random() < 0.5 else x, examples.labels[take]


def fit(
    batches: Iterable[tuple[Floats, OutputGradient]],
    mean: Floats,
    deviation: Floats,
    layers: tuple[int, int],
    steps: int,
    decay: float,
    rng: np.random.Generator,
) -> list[Floats]:
    """Return the weights of a network with `layers` (hidden units, outputs), trained in `steps` batches.

    The training has Adam, a cosine schedule of the learning rate, dropout and decoupled weight decay. The inputs in
    `batches` are normalised with `mean` and `deviation`, (inputs,) each. The weights include both, so the network takes
    raw inputs.
    """
    (hidden, outputs), inputs = layers, len(mean)
    weights = [
        rng.normal(0.0, (2.0 / inputs) ** 0.5, (inputs, hidden)).astype(np.float32),
        np.zeros(hidden, np.float32),
        rng.normal(0.0, (1.0 / hidden) ** 0.5, (hidden, outputs)).astype(np.float32),
        np.zeros(outputs, np.float32),
    ]
    firsts, seconds = [np.zeros_like(w) for w in weights], [np.zeros_like(w) for w in weights]
    for k, (x, output_gradient) in enumerate(batches):
        rate = np.float32(RATE * 0.5 * (1.0 + np.cos(np.pi * k / steps)) + 1e-5)
        active = (rng.random((len(x), hidden), np.float32) >= DROPOUT) / np.float32(1.0 - DROPOUT)
        for i, gradient in enumerate(gradients(weights, x, active, output_gradient)):
            firsts[i] += (1.0 - FIRST) * (gradient - firsts[i])
            seconds[i] += (1.0 - SECOND) * (gradient * gradient - seconds[i])
            step = firsts[i] / (1.0 - FIRST ** (k + 1)) / (np.sqrt(seconds[i] / (1.0 - SECOND ** (k + 1))) + 1e-8)
            weights[i] -= rate * (step + (decay * weights[i] if weights[i].ndim > 1 else 0.0)).astype(np.float32)
    raw = weights[0] / deviation[:, None]
    return [raw, weights[1] - mean @ raw, *weights[2:]]


def gradients(
    weights: Sequence[NDArray[np.floating]],
    x: NDArray[np.floating],
    active: NDArray[np.floating],
    output_gradient: OutputGradient,
) -> list[NDArray[np.floating]]:
    """Return the gradients of the mean cost with respect to the arrays of weights.

    x: (N, inputs). active: (N, H), dropout factor of each hidden unit; 0 if the unit is off.
    """
    hidden, hidden_bias, out, out_bias = weights
    before = x @ hidden + hidden_bias
    layer = np.maximum(before, 0.0) * active
    error = output_gradient(layer @ out + out_bias)
    back = (error @ out.T) * (before > 0.0) * active
    return [x.T @ back, back.sum(axis=0), layer.T @ error, error.sum(axis=0)]
