"""What the questions of a chain come to: quantiles of each link, and of the rate that it serves."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dronecats.report.table import ReportTable, numbers, table_of, words
from dronecats.study.rate.chain import QuestionTimes

LEVELS = (0.0, 0.5, 0.9, 0.99, 1.0)
HEAD = ("min", "median", "90 %", "99 %", "max")
LINKS = {  # field of QuestionTimes → the link of the chain, for people
    "age_s": "picture's age",
    "wait_s": "waiting for it",
    "encode_s": "encoding",
    "failed_s": "turn, retries",
    "model_s": "model",
    "parse_s": "parsing, control",
    "tick_s": "ticks",
    "step_s": "whole step",
    "latency_s": "to be charged",
}
AGES = {
    True: "since it was taken, as the camera stamps it",
    False: "since it arrived here: exposure, coding and network before that are in no figure",
}
CLOCK = "the host's monotonic clock"
AGE_CLOCK = "the vehicle's clock, to one message of its telemetry"


@dataclass(frozen=True, slots=True)
class LinkQuantiles:
    """Of one link, s, or of a rate, Hz; between two measured values as far as the quantile is (linear)."""

    min: float
    median: float
    p90: float
    p99: float
    max: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainSummary:
    """What was measured."""

    pilot: str
    questions: int  # that led to a setpoint
    camera_stamps: bool
    links: dict[str, LinkQuantiles]  # by field of QuestionTimes, s
    chain_hz: LinkQuantiles  # 1 / step_s: as often as the chain could be gone through
    served_hz: LinkQuantiles | None  # of vehicle time, with each action flown before the next question; None: of one

    @property
    def frame_delay_s(self) -> float:
        """Return what a simulated picture's delay has to be, s: as old as the median one was, or waited for."""
        return round(max(self.links["age_s"].median, self.links["wait_s"].median), 3)

    def as_json(self) -> dict[str, Any]:
        """Return it for `--json`."""
        return {
            "pilot": self.pilot,
            "questions": self.questions,
            "clock": CLOCK,
            "age_clock": AGE_CLOCK,
            "age_since": "capture" if self.camera_stamps else "arrival",
            "links": {name: asdict(each) for name, each in self.links.items()},
            "chain_hz": asdict(self.chain_hz),
            "served_hz": asdict(self.served_hz) if self.served_hz else None,
            "frame_delay_s": self.frame_delay_s,
        }


def summarised(times: Sequence[QuestionTimes], pilot: str, *, camera_stamps: bool) -> ChainSummary:
    """Return what questions come to, one at least."""
    served = [each.rate_hz for each in times if each.rate_hz is not None]
    return ChainSummary(
        pilot=pilot,
        questions=len(times),
        camera_stamps=camera_stamps,
        links={name: _quantiles([getattr(each, name) for each in times]) for name in LINKS},
        chain_hz=_quantiles([1.0 / each.step_s for each in times]),
        served_hz=_quantiles(served) if served else None,
    )


def table(of: ChainSummary, wanted: int | None = None) -> ReportTable:
    """Return it for a person; `wanted` questions were to be asked, None: as many as the time allowed."""
    rows = [(said, of.links[name], "s", 4) for name, said in LINKS.items()]
    rows.append(("chain's rate", of.chain_hz, "Hz", 3))
    if of.served_hz:
        rows.append(("served rate", of.served_hz, "Hz", 3))
    of_wanted = "" if wanted is None or wanted <= of.questions else f" of {wanted}"
    return table_of(
        (words("link"), words(""), *map(numbers, HEAD)),
        ((said, unit, *(f"{value:.{digits}f}" for value in asdict(quantiles).values()))
         for said, quantiles, unit, digits in rows),
        f"{of.questions}{of_wanted} questions to {of.pilot}, by {CLOCK}.",
        f"The picture's age: by {AGE_CLOCK}, {AGES[of.camera_stamps]}.",
        "The chain's rate is 1 over the whole step; the served rate has each action flown before the next.",
    )  # fmt: skip


def _quantiles(values: Sequence[float]) -> LinkQuantiles:
    return LinkQuantiles(*(round(float(each), 6) for each in np.quantile(values, LEVELS)))
