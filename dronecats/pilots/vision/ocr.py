"""Reads text in a part of a picture, and compares it with the inscription of a command.

The OCR engine is RapidOCR (Apache-2.0) on ONNX Runtime, on the CPU and in one thread, so that equal pictures give equal
texts. RapidOCR's wheel contains the models. `python -m benchmarks.reading` measures the readings over distance and
angle.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np

from dronecats.pilots.vision.colors import Picture
from dronecats.pilots.vision.command import Inscription, plain_text
from foundation import extras

SURE_CONFIDENCE = 0.90  # least confidence of a sure reading; wrong readings at short distance have less
_ENLARGED = 4.0  # largest enlargement: letters of 8 px get the size that the models expect
_LARGEST_PX = 960  # the longer side of an enlarged part has at most this length
_LEAST_PX = 6  # a line is read only if its height and its width are at least this


@dataclass(frozen=True, slots=True)
class ReadText:
    """A text that the OCR engine has read."""

    text: str
    confidence: float  # 0 … 1


def matches(wanted: Inscription, readings: list[ReadText]) -> bool | None:
    """Return whether a reading is the wanted inscription; None if no sure reading decides.

    An unsure reading never counts as another inscription, because leaving the target is worse than another look.
    """
    texts = [plain_text(r.text) for r in readings if r.confidence >= SURE_CONFIDENCE]
    if wanted.text in texts:
        return True
    for text in texts:
        if len(text) == len(wanted.text) and text.isdigit() == wanted.text.isdigit():
            return False
        if not wanted.on_plate and len(text) >= 3:
            return False
    return None


def check_installed() -> None:
    """Raise UsageError if a package of the OCR engine is not installed."""
    extras.require("rapidocr", "onnxruntime")


@cache
def load_engine() -> Any:
    """Return the OCR engine, one per process. Raises UsageError if one of its packages is not installed."""
    check_installed()
    from rapidocr import RapidOCR

    threads = {f"EngineConfig.onnxruntime.{which}_op_num_threads": 1 for which in ("intra", "inter")}
    return RapidOCR(params={"Global.log_level": "error", "Global.text_score": 0.0, **threads})


def read_line(part: Picture, stretch: float = 1.0) -> list[ReadText]:
    """Return the single line of text in `part` (H, W, 3) BGR; empty if there is none, or if `part` is too small.

    `stretch` widens a part that is seen at an angle.
    """
    if min(part.shape[:2]) < _LEAST_PX:
        return []
    result = load_engine()(_enlarged(part, stretch), use_det=False, use_cls=False, use_rec=True)
    return _readings(result)


def read_lines(part: Picture, stretch: float = 1.0) -> list[ReadText]:
    """Return the lines of text in `part` (H, W, 3) BGR, top to bottom; several lines also joined as a last entry."""
    if min(part.shape[:2]) < 2 * _LEAST_PX:
        return []
    result = load_engine()(_enlarged(part, stretch), use_det=True, use_cls=False, use_rec=True)
    readings = _readings(result)
    if len(readings) > 1:
        readings.append(ReadText(" ".join(r.text for r in readings), min(r.confidence for r in readings)))
    return readings


def _enlarged(part: Picture, stretch: float) -> Picture:
    height, width = part.shape[:2]
    scale = min(_ENLARGED, _LARGEST_PX / max(height, stretch * width))
    size = (max(8, round(width * scale * stretch)), max(8, round(height * scale)))
    return np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def _readings(result: Any) -> list[ReadText]:
    if not result.txts:
        return []
    return [ReadText(str(t), float(s)) for t, s in zip(result.txts, result.scores, strict=True) if t]
