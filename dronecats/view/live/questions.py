"""What a pilot was asked, put together again from what its flight is and what it has decided: no log holds it."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from dronecats.agent.action import Action, ActionError, action_from
from dronecats.agent.history import History
from dronecats.agent.names import PAPER, STEADY
from dronecats.agent.prompt import Prompt, labels
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import from_json
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.protocol import HISTORY_LENGTH
from foundation.run_folder.rows import Decision


class AskedQuestions:
    """The prompts of a flight's decisions, told in their order."""

    def __init__(self, spec: FlightSpec | None, instruction: str, drones: int) -> None:
        """`spec` as run.json has it; None, or an agent of somebody's own: no prompt is known."""
        known = spec is not None and spec.agent in (PAPER, STEADY)
        self._spec = spec if known else None
        self._prompt = None if spec is None or not known else _prompt(spec)
        self._instruction, self._drones = instruction, drones
        self._goals: dict[int, str] = {}
        self._histories: dict[int, History] = defaultdict(lambda: History(CameraModel()))

    def goal(self, drone: int, goal: str) -> None:
        """A commander has given a drone another goal: its pilot begins anew."""
        if self._goals.get(drone) != goal:
            self._goals[drone] = goal
            self._histories.pop(drone, None)

    def asked(self, decisions: Sequence[Decision]) -> str:
        """Return the text of the question of which these decisions came, of one step, and take note of them."""
        text = self._rendered(decisions)
        for one in decisions:
            if (action := _action(one)) is not None:
                self._histories[one.drone].append(action)
        return text

    def _rendered(self, decisions: Sequence[Decision]) -> str:
        spec, first = self._spec, decisions[0]
        if spec is None or self._prompt is None:
            return ""
        together = range(self._drones) if spec.command == "flat" else (first.drone,)
        histories = [self._histories[k].render() for k in together]
        named = zip(labels(len(together)), histories, strict=True) if len(together) > 1 else ()
        told = "\n".join(f"{label}\n{history}" for label, history in named) or histories[0]
        asked = spec.model or spec.outside
        return self._prompt.render(
            self._goals.get(first.drone, self._instruction),
            told,
            HISTORY_LENGTH,
            asked.axis_order if asked else "xy",
            len(together),
        )


def spec_in(configuration: dict[str, Any] | None) -> FlightSpec | None:
    """Return the flight that a run.json tells, None where it tells none that we know."""
    try:
        return from_json(configuration["flight"], "run.json") if configuration and "flight" in configuration else None
    except UsageError:
        return None


def _prompt(spec: FlightSpec) -> Prompt | None:
    try:
        return Prompt.load() if spec.prompt is None else Prompt.of(spec.prompt, "the prompt")
    except UsageError:
        return None


def _action(decision: Decision) -> Action | None:
    try:
        return action_from(decision.action)
    except ActionError:
        return None
