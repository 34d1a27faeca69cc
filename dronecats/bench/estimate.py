"""What a benchmark is going to cost: foreseen before it flies, and measured on the flights that have ended.

A flight that fails flies to its cap and costs most. Each flight that is left is taken for such a one.
"""

import statistics
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from dronecats.agent.history import NONE_YET
from dronecats.agent.latency import Circumstance, Question
from dronecats.agent.models.http_model import tokens_of
from dronecats.agent.models.ledger import cost
from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.prompt import Prompt
from dronecats.bench.benchmark_folder import setting_of
from dronecats.bench.campaign import OpenRun
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.report.results.usage import usage_of
from foundation.errors import UsageError
from foundation.protocol import HISTORY_LENGTH, STEP_S
from foundation.run_folder.results import SCORED, Result

REPLY_TOKENS = 40  # of an action as JSON, without reasoning
LATENCY_S = 0.5  # of a reply, where the latency policy does not foresee it
STEPS = 20  # whose foreseen latencies are averaged


class CostEstimate:
    """The cost of the flights of models that are left. It gets better as flights end."""

    def __init__(self, runs: Sequence[OpenRun], left: Collection[tuple[str, str]]) -> None:
        """`left`: what is still to be flown, (run, episode) by name, as `Campaign.left` has it."""
        self._left: dict[tuple[str, str], tuple[OpenRun, str]] = {
            (run.entry.name, run.batch.folder(episode).name): (run, episode)
            for run in runs
            if run.entry.flight.model is not None
            for episode in run.part
            if (run.entry.name, episode) in left
        }
        self._failed: dict[str, list[float]] = {}  # $ of each flight that failed, by setting
        self._other: dict[str, list[float]] = {}  # $ of each that succeeded, likewise
        self._foreseen: dict[tuple[str, str], float] = {}  # $ by setting and episode

    @property
    def flights(self) -> int:
        """How many flights of models are left."""
        return len(self._left)

    @property
    def unpriced(self) -> str | None:
        """A model whose price is not known, PROVIDER/NAME; None: all are."""
        models = (model for run, _ in self._left.values() for model in _models(run.entry.flight))
        return next((model.title for model in models if None in (model.input_usd, model.output_usd)), None)

    def came(self, run: OpenRun, result: Result, *, again: bool = False) -> None:
        """Take in a flight that has ended; `again`: it is flown once more."""
        if not again:
            self._left.pop((run.entry.name, result.episode), None)
        usd = _measured_usd(run, result.episode) if result.outcome in SCORED else None
        if usd is not None:
            kept = self._other if result.outcome == "success" else self._failed
            kept.setdefault(setting_of(run.entry), []).append(usd)

    def left_usd(self) -> float | None:
        """Return the $ of what is left; None where a price is not known."""
        if self.unpriced is not None:
            return None
        return sum(self._flight_usd(run, episode) for run, episode in self._left.values())

    def _flight_usd(self, run: OpenRun, episode: str) -> float:
        setting = setting_of(run.entry)
        if known := self._failed.get(setting) or self._other.get(setting):
            return statistics.median(known)
        if (setting, episode) not in self._foreseen:
            self._foreseen[setting, episode] = foreseen_usd(run.entry.flight, run.batch.record(episode))
        return self._foreseen[setting, episode]


def foreseen_usd(flight: FlightSpec, record: Mapping[str, Any]) -> float:
    """Return the $ of a flight to its cap, before anything is known of its model: no reply reasons."""
    model = flight.model
    assert model is not None
    drones = flight.drones or len(record["starts"])
    together = drones if flight.command == "flat" else 1  # that are asked for in one question
    prompt = Prompt.load() if flight.prompt is None else Prompt.of(flight.prompt, "the prompt")
    text = prompt.render(str(record["instruction"]), NONE_YET, HISTORY_LENGTH, model.axis_order, together)
    questions = flight.seconds / (STEP_S + _latency_s(flight)) * drones / together
    tokens_in = tokens_of(Request(text, (b"",) * together, thinking=False))
    return questions * cost(model, tokens_in, REPLY_TOKENS * together)


def _latency_s(flight: FlightSpec) -> float:
    """Return the mean vehicle time of a reply, as far as the policy foresees it."""
    if not flight.latency.foreseen:
        return LATENCY_S
    return statistics.fmean(flight.latency.charge_s(Question((0,), k, 0), Circumstance(None)) for k in range(STEPS))


def _measured_usd(run: OpenRun, episode: str) -> float | None:
    """Return the $ of a flight by its logs; None where they are damaged, or its tokens were not counted."""
    pilot = run.entry.flight.model
    if pilot is None:
        return None
    commander = run.entry.flight.commander or pilot
    try:
        used = usage_of(run.batch.run / episode)
    except UsageError:
        return None
    if used.tokens_in is None or used.tokens_out is None:
        return None
    commanded = cost(commander, used.commander_in or 0, used.commander_out or 0)
    return cost(pilot, used.tokens_in, used.tokens_out) + commanded


def _models(flight: FlightSpec) -> list[ModelSpec]:
    return [model for model in (flight.model, flight.commander) if model is not None]
