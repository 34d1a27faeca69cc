"""What LeRobot scales its inputs by: least, greatest, mean and deviation of each feature, of an episode and of all."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

EVERY_PX = 4  # pixels of a picture that are counted, a row and a column


@dataclass(frozen=True, slots=True)
class Moments:
    """Of one feature, an entry per number of it; of pictures (3, 1, 1), per colour, on 0 … 1."""

    least: NDArray[np.float64]
    greatest: NDArray[np.float64]
    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    count: int  # frames

    def as_lists(self) -> dict[str, Any]:
        """Return them under LeRobot's names."""
        told = {"min": self.least, "max": self.greatest, "mean": self.mean, "std": self.std}
        return {**{name: value.tolist() for name, value in told.items()}, "count": [self.count]}


def moments(values: NDArray[Any]) -> Moments:
    """Return those of a feature, (n,) or (n, k)."""
    table = values.reshape(len(values), -1).astype(np.float64)
    return Moments(table.min(0), table.max(0), table.mean(0), table.std(0), len(table))


def image_moments(pictures: Sequence[NDArray[np.uint8]]) -> Moments:
    """Return those of pictures (h, w, 3), of which not every pixel is looked at."""
    seen = np.concatenate([each[::EVERY_PX, ::EVERY_PX].reshape(-1, 3) for each in pictures]) / 255.0
    least, greatest, mean, std = (
        part.reshape(3, 1, 1) for part in (seen.min(0), seen.max(0), seen.mean(0), seen.std(0))
    )
    return Moments(least, greatest, mean, std, len(pictures))


def merged(parts: Sequence[Moments]) -> Moments:
    """Return those of several episodes together."""
    weights = np.array([part.count for part in parts], np.float64) / sum(part.count for part in parts)
    shape = (-1,) + (1,) * parts[0].mean.ndim
    means, variances = np.array([p.mean for p in parts]), np.array([p.std**2 for p in parts])
    mean = (weights.reshape(shape) * means).sum(0)
    variance = (weights.reshape(shape) * (variances + (means - mean) ** 2)).sum(0)
    least, greatest = np.min([p.least for p in parts], 0), np.max([p.greatest for p in parts], 0)
    return Moments(least, greatest, mean, np.sqrt(variance), sum(part.count for part in parts))
