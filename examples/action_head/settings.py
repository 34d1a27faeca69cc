"""The sizes of the head and the settings of its training. With flights and seed they decide the result."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Shape:
    """The sizes of a network."""

    channels: int = 64  # of the maps on the grid of 32 × 18 cells
    words: int = 32  # numbers that an instruction becomes
    hidden: int = 96  # numbers that the actions are read from


@dataclass(frozen=True, slots=True)
class Training:
    """The settings of a fit."""

    epochs: int = 20
    batch: int = 16
    rate: float = 2e-3  # the learning rate at its highest
    decay: float = 0.02  # of the weights
    seed: int = 0
    threads: int = 1  # of PyTorch; the same number gives the same weights
