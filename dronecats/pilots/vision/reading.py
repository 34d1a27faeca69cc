"""Reads what is written in a part of a picture, with an OCR package whose models come within its wheel.

RapidOCR (Apache-2.0) on ONNX Runtime, both on the CPU and in one thread, so that equal pictures give equal texts.
Measured against distance and angle by `python -m benchmarks.reading`.
"""

from functools import cache
from typing import Any

import cv2
import numpy as np

from dronecats.pilots.vision.inscription import ReadText
from dronecats.pilots.vision.paint import Picture
from foundation import extras

_ENLARGED = 4.0  # times; letters of 8 px become as large as those that the models were made for
_LARGEST_PX = 960  # of an enlarged part
_LEAST_PX = 6


def check_installed() -> None:
    """Raise UsageError when a package that reads text is not installed."""
    extras.require("rapidocr", "onnxruntime")


@cache
def _engine() -> Any:
    """Return the OCR engine, made once a process. Raises UsageError as `check_installed` does."""
    check_installed()
    from rapidocr import RapidOCR

    threads = {f"EngineConfig.onnxruntime.{which}_op_num_threads": 1 for which in ("intra", "inter")}
    return RapidOCR(params={"Global.log_level": "error", "Global.text_score": 0.0, **threads})


def ready() -> None:
    """Raise UsageError, one sentence, when nothing can be read here."""
    _engine()


def line(part: Picture, stretch: float = 1.0) -> list[ReadText]:
    """Return the one line of text that fills `part` (H, W, 3) BGR, widened by `stretch` where it is seen aslant."""
    if min(part.shape[:2]) < _LEAST_PX:
        return []
    found = _engine()(_enlarged(part, stretch), use_det=False, use_cls=False, use_rec=True)
    return _readings(found)


def lines(part: Picture, stretch: float = 1.0) -> list[ReadText]:
    """Return the lines of text somewhere in `part` (H, W, 3) BGR, top to bottom, and all of them as one."""
    if min(part.shape[:2]) < 2 * _LEAST_PX:
        return []
    found = _engine()(_enlarged(part, stretch), use_det=True, use_cls=False, use_rec=True)
    readings = _readings(found)
    if len(readings) > 1:
        readings.append(ReadText(" ".join(r.text for r in readings), min(r.confidence for r in readings)))
    return readings


def _enlarged(part: Picture, stretch: float) -> Picture:
    height, width = part.shape[:2]
    scale = min(_ENLARGED, _LARGEST_PX / max(height, stretch * width))
    size = (max(8, round(width * scale * stretch)), max(8, round(height * scale)))
    return np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def _readings(found: Any) -> list[ReadText]:
    if not found.txts:
        return []
    return [ReadText(str(t), float(s)) for t, s in zip(found.txts, found.scores, strict=True) if t]
