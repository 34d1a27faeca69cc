"""What a pilot was asked, rendered again from run.json, record and log: a run keeps the digest of its prompt."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dronecats.agent.action import Action, ActionError, AxisOrder, action_from
from dronecats.agent.command_prompt import CommandPrompt
from dronecats.agent.history import History
from dronecats.agent.names import PAPER, STEADY, agent_name
from dronecats.agent.prompt import Prompt, labels
from foundation.camera import CameraModel
from foundation.protocol import HISTORY_LENGTH
from foundation.run_folder.rows import Decision, Exchange

PAPERS = (PAPER, STEADY)  # one's own may ask what it likes, and these two alike
_SLOT = "\0"  # where the history stands in a prompt; no text has one


@dataclass(frozen=True, slots=True)
class AskedPrompt:
    """The text of one question."""

    parts: tuple[str, ...]  # before, between and after the places of the history: the same over many steps
    history: str

    @property
    def text(self) -> str:
        """Return it whole."""
        return self.history.join(self.parts)


def camera_of(configuration: Mapping[str, Any]) -> CameraModel:
    """Return the camera of a run, the benchmark's where run.json names none."""
    told = configuration.get("camera") or {}
    default = CameraModel()
    try:
        return CameraModel(
            int(told.get("width", default.width)),
            int(told.get("height", default.height)),
            float(told.get("hfov_deg", default.hfov_deg)),
        )
    except (TypeError, ValueError):
        return default


def action_of(decision: Decision) -> Action | None:
    """Return a decision's action; None where there is none, or none that this version knows."""
    try:
        return None if decision.action is None else action_from(decision.action)
    except ActionError:
        return None


def asked(
    configuration: Mapping[str, Any],
    instruction: str,
    decisions: Sequence[Decision],
    exchanges: Sequence[Exchange] = (),
) -> list[AskedPrompt | None]:
    """Return what each decision was asked with, None where that cannot be told: another template, another agent.

    `configuration` is what run.json holds, `instruction` the episode's. What a commander ordered counts for a pilot's
    questions after it; a confirmation was asked for by nobody but the commander, and has no prompt of its own.
    """
    prompt = _template(configuration)
    if prompt is None:
        return [None] * len(decisions)
    axis_order: AxisOrder = "yx" if (_flight(configuration).get("model") or {}).get("axis_order") == "yx" else "xy"
    camera = camera_of(configuration)
    goals: dict[int, str] = {}
    histories: dict[int, History] = {}
    found: list[AskedPrompt | None] = []
    for together in _questions(decisions):
        first = together[0]
        if isinstance(first.confirmed_by, int):
            found += [None] * len(together)
            continue
        goal = _goal(first, exchanges) or instruction
        for each in together:
            if goals.setdefault(each.drone, goal) != goal:  # a new goal is a new context
                goals[each.drone], histories[each.drone] = goal, History(camera)
        past = [histories.setdefault(each.drone, History(camera)) for each in together]
        whole = prompt.render(goal, _SLOT, HISTORY_LENGTH, axis_order, len(together))
        question = AskedPrompt(tuple(whole.split(_SLOT)), _rendered(past))
        found += [question] * len(together)
        for history, each in zip(past, together, strict=True):
            action = action_of(each)
            if action is not None:
                history.append(action)
    return found


def commanded(configuration: Mapping[str, Any], instruction: str, exchange: Exchange) -> str | None:
    """Return what a commander was asked in one exchange; None where its template was another one."""
    prompt = CommandPrompt.load()
    if configuration.get("commander_prompt_sha256") != prompt.digest:
        return None
    return prompt.render(instruction, exchange.roster, exchange.causes, len(exchange.frames))


def _flight(configuration: Mapping[str, Any]) -> Mapping[str, Any]:
    return configuration.get("flight") or {}


def _template(configuration: Mapping[str, Any]) -> Prompt | None:
    """Return the template that flew; None: it was another one than can be had, or none of ours."""
    own = _flight(configuration).get("prompt")
    prompt = Prompt(own) if isinstance(own, str) else Prompt.load()
    known = prompt.digest == configuration.get("prompt_sha256")
    return prompt if known and agent_name(configuration.get("agent")) in PAPERS else None


def _questions(decisions: Sequence[Decision]) -> list[list[Decision]]:
    """Return the decisions by the question that they answer, in the order of the log."""
    found: list[list[Decision]] = []
    for decision in decisions:
        if found and found[-1][0].step == decision.step:
            found[-1].append(decision)
        else:
            found.append([decision])
    return found


def _goal(decision: Decision, exchanges: Sequence[Exchange]) -> str | None:
    """Return the last goal that its drone had when it was asked for; None: it had none of a commander."""
    asked_s = decision.t_decided - (decision.latency_s or 0.0)
    given = [
        order.goal
        for exchange in exchanges
        for order in exchange.orders
        if order.drone == decision.drone and exchange.t_answered is not None and exchange.t_answered < asked_s
    ]
    return given[-1] if given else None


def _rendered(past: Sequence[History]) -> str:
    if len(past) == 1:
        return past[0].render()
    return "\n".join(f"{label}\n{one.render()}" for label, one in zip(labels(len(past)), past, strict=True))
