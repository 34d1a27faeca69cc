"""One question's way through the chain, by the moments at which its links hand over. Which clock, the caller says."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dronecats.agent.models.model import Reply
from dronecats.report.table import ReportTable, numbers, table_of, words
from foundation.run_folder.rows import Decision

DIGITS = 6  # of seconds: µs


@dataclass(frozen=True, slots=True, kw_only=True)
class QuestionTimes:
    """A question that led to a setpoint: a line of chain.csv. Host seconds, unless a field says otherwise."""

    step: int  # as in decisions.jsonl
    frame_id: int
    age_s: float  # s of vehicle time, of the picture when it was in hand
    wait_s: float  # from asking for the picture to having it in hand
    encode_s: float  # JPEG, prompt, request body, and taking the answer apart: all that the client does itself
    failed_s: float  # attempts that failed, the pauses after them, and waiting for a turn
    model_s: float  # from sending the request that was answered to having its answer
    parse_s: float  # from the reply to the controller's setpoint
    tick_s: float  # waiting for the agent's next tick: with the picture, with the reply, with the setpoint
    step_s: float  # from asking for the picture to the setpoint as it would be sent: the sum of all but the age
    latency_s: float  # encode_s + model_s + parse_s: what a simulation charges for the reply, having ticks of its own
    rate_hz: float | None  # decisions per s of vehicle time since the last one, actions flown; None: the first


@dataclass(slots=True)
class _Question:
    """One on its way: the moments (s) that have been."""

    asked_s: float  # for the picture
    came_s: float = 0.0
    age_s: float = 0.0
    seen_s: float | None = None  # when the agent took the picture up
    answered_s: float = 0.0
    reply: Reply | None = None
    heard_s: float = 0.0  # when the agent took the reply up
    decision: Decision | None = None
    flown_s: float | None = None  # when the controller had its setpoint


class ChainClock:
    """Hears of each moment as it comes, and tells a question when its setpoint is there.

    There is one question at a time, asked by an agent of one drone; so none of this is locked, although picture and
    reply come on threads of their own. A question without a setpoint is never told: it has not been through the chain.
    """

    def __init__(self, wall_s: Callable[[], float], on_times: Callable[[QuestionTimes], None]) -> None:
        """`wall_s` reads the clock that all is measured by; `on_times` hears of each question that is through."""
        self._wall_s, self._on_times = wall_s, on_times
        self._asking: _Question | None = None
        self._decided: _Question | None = None  # its setpoint is not there yet
        self._ticked_s = 0.0

    def picture_asked(self) -> None:
        """A picture is asked for: a question begins."""
        self._asking = _Question(self._wall_s())

    def picture_came(self, age_s: float) -> None:
        """The picture is in hand, `age_s` old."""
        if self._asking is not None:
            self._asking.came_s, self._asking.age_s = self._wall_s(), age_s

    def picture_seen(self) -> None:
        """The agent has taken the picture up."""
        if self._asking is not None and self._asking.seen_s is None:
            self._asking.seen_s = self._wall_s()

    def answered(self, reply: Reply) -> None:
        """The reply has left the model's client."""
        if self._asking is not None:
            self._asking.answered_s, self._asking.reply = self._wall_s(), reply

    def ticked(self) -> None:
        """A tick has passed, and the agent goes on."""
        self._ticked_s = self._wall_s()

    def decided(self, decision: Decision) -> None:
        """The reply has been read."""
        if (asking := self._asking) is not None and asking.reply is not None:
            asking.decision = decision
            asking.heard_s = max(asking.answered_s, self._ticked_s)
            self._decided = asking

    def flown(self) -> None:
        """The controller has given a setpoint."""
        if self._decided is not None and self._decided.flown_s is None:
            self._decided.flown_s = self._wall_s()

    def setpoint_made(self) -> None:
        """The setpoint is there as it would be sent."""
        decided = self._decided
        if decided is not None and decided.flown_s is not None:
            self._decided = None
            self._on_times(_times(decided, self._wall_s()))


def _times(of: _Question, sent_s: float) -> QuestionTimes:
    assert of.reply is not None
    assert of.decision is not None
    assert of.flown_s is not None
    seen_s = of.came_s if of.seen_s is None else of.seen_s
    model_s, failed_s = of.reply.latency_s, of.reply.waited_s
    encode_s = of.answered_s - seen_s - model_s - failed_s
    parse_s = of.flown_s - of.heard_s
    return QuestionTimes(
        step=of.decision.step,
        frame_id=of.decision.frame_id,
        age_s=round(of.age_s, DIGITS),
        wait_s=round(of.came_s - of.asked_s, DIGITS),
        encode_s=round(encode_s, DIGITS),
        failed_s=round(failed_s, DIGITS),
        model_s=round(model_s, DIGITS),
        parse_s=round(parse_s, DIGITS),
        tick_s=round(seen_s - of.came_s + of.heard_s - of.answered_s + sent_s - of.flown_s, DIGITS),
        step_s=round(sent_s - of.asked_s, DIGITS),
        latency_s=round(encode_s + model_s + parse_s, DIGITS),
        rate_hz=of.decision.rate_hz,
    )


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
