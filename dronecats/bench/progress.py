"""Progress and cost of a campaign.

`Progress` reads no clock: the caller passes all times. `CostEstimate` predicts the cost, and corrects it with the
flights that have ended. It assumes that each remaining flight fails, because failed flights cost most.
"""

import itertools
import statistics
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dronecats.agent.commanding.command_prompt import INTERVAL_S, CommandPrompt
from dronecats.agent.latency import Circumstance, Question
from dronecats.agent.models.ledger import Spent, cost
from dronecats.agent.models.model import Request, tokens_of
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.prompt import NONE_YET, Prompt
from dronecats.bench.benchmark_folder import setting_of
from dronecats.bench.campaign import OpenRun
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.judge.statistics.shares import estimate_share
from dronecats.report.results.collection import usage_of
from foundation.errors import UsageError
from foundation.protocol import HISTORY_LENGTH, STEP_S
from foundation.run_folder.results import SCORED, Result
from foundation.run_folder.rows import Cause
from foundation.wording import counted

HOUR_S = 3600.0


@dataclass(slots=True)
class Progress:
    """Counts of the flights of a campaign. `before`: number of flights that earlier processes have done."""

    total: int
    before: int = 0
    outcomes: dict[str, list[bool]] = field(default_factory=dict)  # episode → whether each scored flight succeeded
    errors: int = 0
    retries: int = 0
    ended: int = 0  # flights of this process, retries included

    @property
    def solved(self) -> int:
        return sum(map(sum, self.outcomes.values()))

    @property
    def failed(self) -> int:
        return sum(map(len, self.outcomes.values())) - self.solved

    @property
    def done(self) -> int:
        """Number of flights that have a result, including errors."""
        return self.solved + self.failed + self.errors

    def stored(self, result: Result) -> None:
        """Add the result of a flight from before this process."""
        self.before += 1
        self._count(result)

    def add(self, result: Result, *, again: bool) -> None:
        """Add the result of a flight; `again`: the flight did not move and is retried."""
        self.ended += 1
        if again:
            self.retries += 1
        else:
            self._count(result)

    def per_hour(self, wall_s: float) -> float:
        """Return the flights per hour of this process, which has run for `wall_s`."""
        return self.ended * HOUR_S / wall_s if wall_s > 0.0 else 0.0

    def left_s(self, wall_s: float) -> float | None:
        """Return the wall seconds left at this pace; None before the first flight has ended."""
        return (self.total - self.done) * wall_s / self.ended if self.ended else None

    def line(self, wall_s: float, spent: Spent | None = None, left_usd: float | None = None) -> str:
        """Return the progress as one line; `left_usd`: cost of the remaining flights, None when unknown."""
        fields = [f"{self.done}/{self.total}"]
        left_s = self.left_s(wall_s)
        if left_s is not None and self.done < self.total:
            fields.append(f"{_clock(left_s)} left, {self.per_hour(wall_s):.0f} an hour")
        if self.outcomes:  # as in the table, episodes and not flights are the sample of the interval
            share = estimate_share(list(self.outcomes.values()))
            fields.append(f"SR {share.share:.0%} ({share.low:.0%}–{share.high:.0%})")
        fields.append(f"{self.solved} solved, {self.failed} failed, {counted(self.errors, 'error')}")
        if self.retries:
            fields.append(counted(self.retries, "retry", "retries"))
        if spent is not None and spent.questions:
            usd = f", ${spent.usd:.2f}" if spent.usd else ""
            usd += f" of about ${spent.usd + left_usd:.2f}" if usd and left_usd else ""
            fields.append(f"{spent.tokens:,} tokens{usd}")
        return "; ".join(fields)

    def _count(self, result: Result) -> None:
        if result.outcome in SCORED:
            self.outcomes.setdefault(result.episode, []).append(result.outcome == "success")
        else:
            self.errors += 1


def _clock(seconds: float) -> str:
    minutes, s = divmod(max(1, round(seconds)), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min {s:02d} s" if minutes else f"{s} s"


REPLY_TOKENS = 40  # tokens of a reply: an action as JSON, without reasoning
LATENCY_S = 0.5  # vehicle s; assumed latency of a reply, if the latency policy cannot predict it
STEPS = 20  # number of questions over which predicted latencies are averaged


class CostEstimate:
    """The estimated cost of the remaining flights of models, corrected as flights end."""

    def __init__(self, runs: Sequence[OpenRun], left: Collection[tuple[str, str]]) -> None:
        """`left`: the remaining flights as (name of the run, episode), from `Campaign.left`."""
        self._left: dict[tuple[str, str], tuple[OpenRun, str]] = {
            (run.entry.name, run.batch.folder(episode).name): (run, episode)
            for run in runs
            if run.entry.flight.models
            for episode in run.part
            if (run.entry.name, episode) in left
        }
        self._failed: dict[str, list[float]] = {}  # setting (see `setting_of`) → $ of each failed flight
        self._succeeded: dict[str, list[float]] = {}  # setting → $ of each flight that succeeded
        self._foreseen: dict[tuple[str, str], float] = {}  # (setting, episode) → predicted $

    @property
    def flights(self) -> int:
        """The number of remaining flights of models."""
        return len(self._left)

    @property
    def unpriced(self) -> str | None:
        """A model without prices, PROVIDER/NAME; None when all have prices."""
        models = (model for run, _ in self._left.values() for model in run.entry.flight.models)
        return next((model.title for model in models if None in (model.input_usd, model.output_usd)), None)

    def add(self, run: OpenRun, result: Result, *, again: bool = False) -> None:
        """Add a flight that has ended; `again`: it is retried."""
        if not again:
            self._left.pop((run.entry.name, result.episode), None)
        usd = _measured_usd(run, result.episode) if result.outcome in SCORED else None
        if usd is not None:
            kept = self._succeeded if result.outcome == "success" else self._failed
            kept.setdefault(setting_of(run.entry), []).append(usd)

    def left_usd(self) -> float | None:
        """Return the cost of the remaining flights, $; None when a price is missing."""
        if self.unpriced is not None:
            return None
        return sum(self._flight_usd(run, episode) for run, episode in self._left.values())

    def _flight_usd(self, run: OpenRun, episode: str) -> float:
        setting = setting_of(run.entry)
        if measured := self._failed.get(setting) or self._succeeded.get(setting):
            return statistics.median(measured)
        if (setting, episode) not in self._foreseen:
            self._foreseen[setting, episode] = foreseen_usd(run.entry.flight, run.batch.record(episode))
        return self._foreseen[setting, episode]


def foreseen_usd(flight: FlightSpec, record: Mapping[str, Any]) -> float:
    """Return the predicted cost ($) of a flight that lasts to its time limit. Assumes replies without reasoning."""
    drones, instruction = flight.drones or len(record["starts"]), str(record["instruction"])
    usd = 0.0
    if (pilot := flight.model) is not None:
        together = drones if flight.command == "flat" else 1  # drones per question
        prompt = Prompt.load() if flight.prompt is None else Prompt.of(flight.prompt, "the prompt")
        text = prompt.render(instruction, NONE_YET, HISTORY_LENGTH, pilot.axis_order, together)
        questions = flight.seconds / (STEP_S + _latency_s(flight)) * drones / together
        usd += questions * _question_usd(pilot, text, together)
    if (commander := _commander(flight)) is not None:
        text = CommandPrompt.load().render(instruction, "", (Cause(why="time"),), drones)
        usd += (1.0 + flight.seconds / INTERVAL_S) * _question_usd(commander, text, drones)
    return usd


def _question_usd(model: ModelSpec, text: str, pictures: int) -> float:
    """Return the cost ($) of a question with this number of pictures, and of a reply of REPLY_TOKENS per picture."""
    tokens_in = tokens_of(Request(text, (b"",) * pictures, thinking=False))
    return cost(model, tokens_in, REPLY_TOKENS * pictures)


def _latency_s(flight: FlightSpec) -> float:
    """Return the predicted mean latency of a reply, vehicle s; LATENCY_S if the policy cannot predict it."""
    if not flight.latency.foreseen:
        return LATENCY_S
    # each question except the first follows the previous reply after one move; the policy `cap` depends on this time
    since_s = (None, *itertools.repeat(STEP_S, STEPS - 1))
    charges = (flight.latency.charge_s(Question((0,), k, 0), Circumstance(None, s)) for k, s in enumerate(since_s))
    return statistics.fmean(charges)


def _measured_usd(run: OpenRun, episode: str) -> float | None:
    """Return the cost of a flight from its logs, $; None when they are damaged or lack token counts."""
    flight = run.entry.flight
    try:
        used = usage_of(run.batch.run / episode)
    except UsageError:
        return None
    usd = 0.0
    for model, questions, tokens_in, tokens_out in (
        (flight.model, used.questions, used.tokens_in, used.tokens_out),
        (_commander(flight), used.commander_questions, used.commander_in, used.commander_out),
    ):
        if model is not None and questions:
            if tokens_in is None or tokens_out is None:
                return None
            usd += cost(model, tokens_in, tokens_out)
    return usd


def _commander(flight: FlightSpec) -> ModelSpec | None:
    """Return the model that commands the fleet; None if there is no commander, or a built-in one."""
    if flight.command != "hierarchical" or flight.scripted_commander:
        return None
    return flight.commander or flight.model
