"""Measures the timing chain from camera to setpoint: the times of each question to the pilot, and their summary."""

import csv
import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from dronecats.agent.latency import LONGEST_S
from dronecats.agent.models.model import Reply
from dronecats.flight.spec.flight_spec import COLUMN
from dronecats.report.table import ReportTable, numbers, table_of, words
from foundation.errors import InfrastructureError, UsageError
from foundation.files import file_errors_as
from foundation.run_folder.rows import Decision

DIGITS = 6  # decimal places of seconds, so that the resolution is 1 µs


@dataclass(frozen=True, slots=True, kw_only=True)
class QuestionTimes:
    """The times of a question that led to a setpoint: a line of chain.csv. Times are host seconds unless noted."""

    step: int  # as in decisions.jsonl
    frame_id: int
    age_s: float  # s of vehicle time, age of the picture on arrival
    wait_s: float  # time from the request of the picture to its arrival
    encode_s: float  # time for JPEG, prompt, request body and parsing of the response: the client's work
    failed_s: float  # time of waits for the rate limit, failed attempts, and the pauses after them
    model_s: float  # time from request to answer, only of the attempt that was answered
    parse_s: float  # time from the reply to the controller's setpoint
    tick_s: (
        float  # three waits for the agent's next tick, summed: picture, reply and computed setpoint each wait for one
    )
    step_s: float  # time from the request of the picture to the ready setpoint: the sum of all times above except age_s
    latency_s: float  # encode_s + model_s + parse_s: a simulation uses this latency and adds its own ticks
    rate_hz: float | None  # Hz, 1 / vehicle time since the previous decision; None: the first question


@dataclass(slots=True)
class _Question:
    """A question in progress: the moments (s) of its events."""

    requested_s: float  # the agent has requested the picture
    arrived_s: float = 0.0  # the picture has arrived
    age_s: float = 0.0  # age of the picture on arrival
    seen_s: float | None = None  # the agent has taken the picture
    answered_s: float = 0.0  # the model's client has returned the reply
    reply: Reply | None = None
    reply_seen_s: float = 0.0  # the agent has taken the reply
    decision: Decision | None = None
    controlled_s: float | None = None  # the controller has computed its setpoint


class ChainClock:
    """Records the events of each question, and reports the question's times when its setpoint is ready.

    A question without a setpoint is not reported. Pictures and replies arrive on separate threads, but no lock is
    needed: an agent of one drone asks one question at a time.
    """

    def __init__(self, wall_s: Callable[[], float], on_times: Callable[[QuestionTimes], None]) -> None:
        """`wall_s` reads the host's clock (s); `on_times` is called with the times of each finished question."""
        self._wall_s, self._on_times = wall_s, on_times
        self._current = _Question(0.0)  # before the first request: it has no reply, so it is never reported
        self._decided: _Question | None = None  # the question whose setpoint is not ready yet
        self._ticked_s = 0.0

    def picture_requested(self) -> None:
        """Record that a picture is requested, which begins a question."""
        self._current = _Question(self._wall_s())

    def picture_arrived(self, age_s: float) -> None:
        """Record that the picture has arrived; its age is `age_s`."""
        self._current.arrived_s, self._current.age_s = self._wall_s(), age_s

    def picture_seen(self) -> None:
        """Record that the agent has taken the picture."""
        if self._current.seen_s is None:
            self._current.seen_s = self._wall_s()

    def answered(self, reply: Reply) -> None:
        """Record that the model's client has returned the reply."""
        self._current.answered_s, self._current.reply = self._wall_s(), reply

    def ticked(self) -> None:
        """Record that a tick has passed and the agent continues."""
        self._ticked_s = self._wall_s()

    def decided(self, decision: Decision) -> None:
        """Record that the reply has been parsed."""
        if self._current.reply is not None:
            self._current.decision = decision
            self._current.reply_seen_s = max(self._current.answered_s, self._ticked_s)
            self._decided = self._current

    def controller_done(self) -> None:
        """Record that the controller has computed a setpoint."""
        if self._decided is not None and self._decided.controlled_s is None:
            self._decided.controlled_s = self._wall_s()

    def setpoint_ready(self) -> None:
        """Record that the setpoint is ready to be sent, and report the question."""
        question = self._decided
        if question is not None and question.controlled_s is not None:
            self._decided = None
            self._on_times(_times(question, self._wall_s()))


def _times(question: _Question, sent_s: float) -> QuestionTimes:
    assert question.reply is not None
    assert question.decision is not None
    assert question.controlled_s is not None
    seen_s = question.arrived_s if question.seen_s is None else question.seen_s
    model_s, failed_s = question.reply.latency_s, question.reply.waited_s
    encode_s = question.answered_s - seen_s - model_s - failed_s
    parse_s = question.controlled_s - question.reply_seen_s
    return QuestionTimes(
        step=question.decision.step,
        frame_id=question.decision.frame_id,
        age_s=round(question.age_s, DIGITS),
        wait_s=round(question.arrived_s - question.requested_s, DIGITS),
        encode_s=round(encode_s, DIGITS),
        failed_s=round(failed_s, DIGITS),
        model_s=round(model_s, DIGITS),
        parse_s=round(parse_s, DIGITS),
        tick_s=round(
            seen_s - question.arrived_s + question.reply_seen_s - question.answered_s + sent_s - question.controlled_s,
            DIGITS,
        ),
        step_s=round(sent_s - question.requested_s, DIGITS),
        latency_s=round(encode_s + model_s + parse_s, DIGITS),
        rate_hz=question.decision.rate_hz,
    )


QUANTILES = {"min": 0.0, "median": 0.5, "p90": 0.9, "p99": 0.99, "max": 1.0}
HEAD = ("min", "median", "90 %", "99 %", "max")
LINKS = {  # field of QuestionTimes → name of this link of the chain in tables
    "age_s": "image age",
    "wait_s": "wait for image",
    "encode_s": "encoding",
    "failed_s": "queue, retries",
    "model_s": "model",
    "parse_s": "parsing, control",
    "tick_s": "ticks",
    "step_s": "whole step",
    "latency_s": "latency for sim",
}
AGE_NOTES = {  # camera_stamps → note on the image age
    True: "since the image was taken, by the camera's time stamp",
    False: "since the image arrived at this computer; the earlier exposure, coding and network are not included",
}
CLOCK = "the host's monotonic clock"
AGE_CLOCK = "the vehicle's clock, to one message of its telemetry"


# quantiles of one part of the timing chain (s) or of a rate (Hz), by the names in QUANTILES, interpolated linearly
LinkQuantiles = dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainSummary:
    pilot: str
    questions: int  # number of questions that led to a setpoint
    camera_stamps: bool  # whether the camera stamps the time of capture
    links: dict[str, LinkQuantiles]  # s, by field of QuestionTimes
    chain_hz: LinkQuantiles  # 1 / step_s
    served_hz: LinkQuantiles | None  # quantiles of `rate_hz`; None: there is only one question

    @property
    def frame_delay_s(self) -> float:
        """The delay (s) to set for simulated pictures: the larger of the median age and the median wait."""
        return round(max(self.links["age_s"]["median"], self.links["wait_s"]["median"]), 3)

    def as_json(self) -> dict[str, Any]:
        """Return the summary for `--json`."""
        return {
            "pilot": self.pilot,
            "questions": self.questions,
            "clock": CLOCK,
            "age_clock": AGE_CLOCK,
            "age_since": "capture" if self.camera_stamps else "arrival",
            "links": self.links,
            "chain_hz": self.chain_hz,
            "served_hz": self.served_hz,
            "frame_delay_s": self.frame_delay_s,
        }


def summarize(times: Sequence[QuestionTimes], pilot: str, *, camera_stamps: bool) -> ChainSummary:
    rates_hz = [question.rate_hz for question in times if question.rate_hz is not None]
    return ChainSummary(
        pilot=pilot,
        questions=len(times),
        camera_stamps=camera_stamps,
        links={name: _quantiles([getattr(question, name) for question in times]) for name in LINKS},
        chain_hz=_quantiles([1.0 / question.step_s for question in times]),
        served_hz=_quantiles(rates_hz) if rates_hz else None,
    )


def summary_table(summary: ChainSummary, requested: int | None = None) -> ReportTable:
    """Return the summary as a table; `requested` is the requested number of questions, None if there was no number."""
    rows = [(label, summary.links[name], "s", 4) for name, label in LINKS.items()]
    rows.append(("step rate", summary.chain_hz, "Hz", 3))
    if summary.served_hz:
        rows.append(("served rate", summary.served_hz, "Hz", 3))
    of_requested = "" if requested is None or requested <= summary.questions else f" of {requested}"
    return table_of(
        (words("link"), words(""), *map(numbers, HEAD)),
        ((label, unit, *(f"{value:.{digits}f}" for value in quantiles.values()))
         for label, quantiles, unit, digits in rows),
        f"{summary.questions}{of_requested} questions to {summary.pilot}, by {CLOCK}.",
        f"The image age is by {AGE_CLOCK}, {AGE_NOTES[summary.camera_stamps]}.",
        "The step rate is 1 / time of a whole step. The served rate includes the flight of each action.",
    )  # fmt: skip


def _quantiles(values: Sequence[float]) -> LinkQuantiles:
    found = np.quantile(values, list(QUANTILES.values()))
    return {name: round(float(value), 6) for name, value in zip(QUANTILES, found, strict=True)}


CHAIN, TRACE, STUDY = "chain.csv", "trace.csv", "study.toml"
COLUMNS = tuple(field.name for field in fields(QuestionTimes))


class ChainLog:
    """Writes chain.csv: a header and a line per question. Each line is flushed at once."""

    def __init__(self, folder: Path) -> None:
        """Create the file. Raises InfrastructureError."""
        with _write_errors(folder / CHAIN):
            self._file = (folder / CHAIN).open("w", encoding="utf-8", newline="")
            self._rows = csv.writer(self._file)
            self._put(COLUMNS)

    def write(self, times: QuestionTimes) -> None:
        """Append a question. Raises InfrastructureError."""
        with _write_errors(Path(self._file.name)):
            self._put(["" if value is None else value for value in astuple(times)])

    def close(self) -> None:
        self._file.close()

    def _put(self, row: Sequence[object]) -> None:
        self._rows.writerow(row)
        self._file.flush()


def check_fresh(folder: Path) -> None:
    """Raise UsageError if the folder already holds a measured chain."""
    if (folder / CHAIN).exists():
        raise UsageError(f"{folder} already has a measurement. Choose another --out")


def write_replay(folder: Path, times: Sequence[QuestionTimes], frame_delay_s: float) -> None:
    """Write trace.csv for `--latency trace:FILE`, and study.toml, which uses it. Raises InfrastructureError.

    `frame_delay_s`: s, delay of simulated pictures; 0: no delay.
    """
    lines = [COLUMN, *(f"{min(question.latency_s, LONGEST_S):.{DIGITS}f}" for question in times)]
    delay = f"frame_delay = {json.dumps([0, frame_delay_s])}\n" if frame_delay_s else ""
    for name, text in ((TRACE, "\n".join(lines) + "\n"), (STUDY, STUDY_FILE + delay)):
        with _write_errors(folder / name):
            (folder / name).write_text(text, encoding="utf-8")


# a study that compares the measured chain with a chain without latency
STUDY_FILE = f"""# Effect of a measured chain: latency of its replies, age of its pictures. See docs/rate.md
name = "measured-chain"
pilot = ["noisy"]
cells = ["tracking", "approaching"]
suite = "one-drone"

[factors]
latency_policy = ["fixed:0", "trace:{TRACE}"]
"""


def _write_errors(path: Path) -> AbstractContextManager[None]:
    return file_errors_as(InfrastructureError, f"{path} cannot be written", ", so later measurements are lost")
