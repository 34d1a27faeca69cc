"""The sizes of the network and the settings of its training. With the training flights, they determine the result."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Shape:
    """The sizes of a network."""

    channels: int = 64  # feature channels on the grid of 32 × 18 cells
    words: int = 32  # length of the instruction's embedding
    hidden: int = 96  # units of the hidden layer before the outputs


@dataclass(frozen=True, slots=True)
class Training:
    """The settings of a fit."""

    epochs: int = 20
    batch: int = 16
    rate: float = 2e-3  # highest learning rate
    decay: float = 0.02  # weight decay
    seed: int = 0
    threads: int = 1  # threads of PyTorch; another number may give other weights
