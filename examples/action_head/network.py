"""Maps a picture, the instruction's words and the last actions to the four actions and their numbers.

Four convolutions process the picture. After each, the words scale and shift every channel (FiLM, Perez et al.
2018), so that the features depend on the instruction. A heat map of 32 × 18 cells gives the point. The features at
the point and over the whole picture give the kind of action, the depth and the angle.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from examples.action_head.features import HEIGHT, KINDS, PAST, WIDTH, WORDS
from examples.action_head.pilot import COLUMNS, ROWS, TURNS_DEG, Outlook
from examples.action_head.settings import Shape
from foundation.errors import UsageError

FORMAT = 1  # version of the file format


class ActionHead(nn.Module):  # type: ignore[misc]  # PyTorch is a library without types here
    """Maps (pictures, words, past) to four outputs; see `forward`."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        widths = (5, shape.channels // 2, shape.channels, shape.channels, shape.channels)
        looks = zip(widths, widths[1:], (5, 3, 3, 3), (4, 2, 1, 1), strict=False)
        self.words = nn.Sequential(nn.Linear(WORDS, shape.words), nn.ReLU())
        self.looks = nn.ModuleList(
            nn.Conv2d(a, b, size, stride, padding=size // 2, bias=False) for a, b, size, stride in looks
        )
        self.norms = nn.ModuleList(nn.GroupNorm(4, width) for width in widths[1:])
        self.tunes = nn.ModuleList(nn.Linear(shape.words, 2 * width) for width in widths[1:])
        self.heat = nn.Conv2d(shape.channels, 1, 1)
        self.mind = nn.Sequential(
            nn.Linear(3 * shape.channels + 4 + PAST + shape.words, shape.hidden), nn.ReLU(), nn.Dropout(0.2)
        )
        self.kinds = nn.Linear(shape.hidden, len(KINDS))
        self.depth = nn.Linear(shape.hidden, 1)
        self.turns = nn.Linear(shape.hidden, len(TURNS_DEG))

    def forward(self, pictures: Tensor, words: Tensor, past: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return four outputs for n decisions.

        They are logits of kinds (n, 4), logits of cells (n, ROWS · COLUMNS), the natural logarithm of the depth in
        metres (n,), and logits of turns (n, len(TURNS_DEG)).
        pictures: uint8 (n, 3, HEIGHT, WIDTH); words: (n, WORDS); past: (n, PAST).
        """
        instruction = self.words(words)
        seen = torch.cat([pictures.float() / 255.0 - 0.5, _places(len(pictures))], 1)
        for look, norm, tune in zip(self.looks, self.norms, self.tunes, strict=True):
            fresh = norm(look(seen))
            scale, shift = tune(instruction)[:, :, None, None].chunk(2, 1)
            fresh = functional.relu(fresh * (1.0 + scale) + shift)
            seen = fresh + seen if fresh.shape == seen.shape else fresh
        heat = self.heat(seen).flatten(1)
        flat, share = seen.flatten(2), heat.softmax(1)
        there = (flat * share[:, None]).sum(2)
        grid = _places(len(pictures), ROWS, COLUMNS).flatten(2)
        where = (grid * share[:, None]).sum(2)
        sure = torch.stack([heat.amax(1), heat.logsumexp(1)], 1)
        thought = self.mind(torch.cat([there, flat.amax(2), flat.mean(2), where, sure, past, instruction], 1))
        return self.kinds(thought), heat, self.depth(thought)[:, 0], self.turns(thought)

    def outlook(self, picture: NDArray[np.uint8], words: NDArray[np.float32], past: NDArray[np.float32]) -> Outlook:
        """Return the outputs for one picture."""
        self.eval()
        with torch.inference_mode():
            inputs = (torch.from_numpy(array)[None] for array in (picture, words, past))
            kinds, heat, depth, turns = self(*inputs)
        return Outlook(
            kinds=kinds.softmax(1)[0].numpy(),
            heat=heat.softmax(1)[0].reshape(ROWS, COLUMNS).numpy(),
            depth_m=float(depth.exp()),
            turns=turns.softmax(1)[0].numpy(),
        )


def _places(count: int, rows: int = HEIGHT, columns: int = WIDTH) -> Tensor:
    """Return the coordinates of each cell, (count, 2, rows, columns), x and y in -1 … 1."""
    y, x = torch.meshgrid(torch.linspace(-1, 1, rows), torch.linspace(-1, 1, columns), indexing="ij")
    return torch.stack([x, y]).expand(count, 2, rows, columns)


def save(path: Path, head: ActionHead, declares_at: float, about: dict[str, Any]) -> None:
    """Write a trained head. Raises UsageError if the file cannot be written.

    `declares_at`: the least probability of `finished` at which the head declares arrival. `about`: training facts.
    """
    header = {"format": FORMAT, "shape": asdict(head.shape), "declares_at": declares_at, "about": about}
    try:
        torch.save({**header, "weights": head.state_dict()}, path)
    except (OSError, RuntimeError) as error:
        raise UsageError(f"'{path}' cannot be written: {str(error).splitlines()[0]}") from None


def load(path: Path) -> tuple[ActionHead, float]:
    """Return a trained head and its `declares_at`, see `save`. Raises UsageError if the file is not a head."""
    try:
        content = torch.load(path, weights_only=True, map_location="cpu")
        if content["format"] != FORMAT:
            raise UsageError(f"'{path}' is a head of another version. Train it again.")
        head = ActionHead(Shape(**content["shape"]))
        head.load_state_dict(content["weights"])
        return head, float(content["declares_at"])
    except FileNotFoundError:
        raise UsageError(f"'{path}' does not exist. Make one: python -m examples.action_head.train") from None
    except UsageError:
        raise
    except Exception as error:  # PyTorch raises many types for a wrong file
        raise UsageError(f"'{path}' is not a trained head: {str(error).splitlines()[0][:120]}") from None
