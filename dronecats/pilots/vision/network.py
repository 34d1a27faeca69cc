"""Loads, evaluates and saves the vision pilot's networks: one hidden layer of rectified linear units."""

from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Network:
    """The weights of a network with N inputs, H hidden units and K outputs."""

    FILE: ClassVar[str]  # name of the file in this folder that ships with the package

    hidden: Floats  # (N, H)
    hidden_bias: Floats  # (H,)
    out: Floats  # (H, K)
    out_bias: Floats  # (K,)

    @classmethod
    def load(cls, file: Path) -> Self:
        """Return the network in a file. Raises OSError."""
        with np.load(file) as arrays:
            return cls(*(arrays[field.name].astype(np.float32) for field in fields(cls)))

    @classmethod
    @cache
    def shipped(cls) -> Self:
        """Return the network that ships with the package."""
        return cls.load(Path(__file__).with_name(cls.FILE))

    def save(self, file: Path) -> None:
        """Write the weights in half precision."""
        np.savez(file, **{field.name: getattr(self, field.name).astype(np.float16) for field in fields(self)})

    def outputs(self, inputs: Floats) -> Floats:
        """Return the outputs (M, K) for M inputs (M, N)."""
        return np.asarray(np.maximum(inputs @ self.hidden + self.hidden_bias, 0.0) @ self.out + self.out_bias)
