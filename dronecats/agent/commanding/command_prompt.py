"""The prompt of a commander (template and roster of the drones) and the parser of its orders."""

import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from dronecats.agent.action import ActionError, Go
from dronecats.agent.controller import Drone
from dronecats.agent.models.reply_schema import CONFIRM, ORDERS
from dronecats.agent.prompt import compact
from dronecats.agent.reply.strict import answer_of, json_spans
from foundation.protocol import POINT_SPAN
from foundation.run_folder.rows import Cause

_FIELD = re.compile("{(drones|instruction|causes|roster)}")
FLEET = "{n} multirotors, Drone 1 to Drone {n}"
ALONE = "one multirotor, Drone 1"
CAUSES = {
    "start": "The episode begins; nobody has a goal yet, and all drones hover.",
    "report": "Drone {n} says that it has arrived.",
    "stall": "Drone {n} has not moved from its place for {steps} steps.",
    "time": "Nothing was heard of you for {seconds} s.",
}
STALL_STEPS = 8  # a drone stalls after this many decisions in a row without a go; a look around takes six turns of 60°
INTERVAL_S = 45.0  # vehicle s after which the commander is asked again even without an event


@dataclass(frozen=True, slots=True)
class CommandPrompt:
    """The prompt template of a commander. Braces are literal except in the four fields of _FIELD."""

    template: str

    @classmethod
    def load(cls) -> "CommandPrompt":
        """Return the built-in template."""
        return cls(files("dronecats.agent.commanding").joinpath("commander.txt").read_text(encoding="utf-8"))

    @property
    def digest(self) -> str:
        """The SHA-256 of the template and of all fixed text that fills it. run.json holds this value."""
        words = (self.template, FLEET, ALONE, *CAUSES.values())
        return hashlib.sha256("\0".join(words).encode()).hexdigest()

    def render(self, instruction: str, roster: str, causes: Sequence[Cause], drones: int) -> str:
        values = {
            "drones": FLEET.replace("{n}", str(drones)) if drones > 1 else ALONE,
            "instruction": instruction,
            "causes": "\n".join(cause_text(cause) for cause in causes),
            "roster": roster,
        }
        return _FIELD.sub(lambda match: values[match[1]], self.template)


def cause_text(cause: Cause) -> str:
    """Return why the commander is asked, as a sentence of the prompt, which counts drones from 1."""
    text = CAUSES[cause.why].replace("{steps}", str(STALL_STEPS)).replace("{seconds}", f"{INTERVAL_S:g}")
    return text if cause.drone is None else text.replace("{n}", str(cause.drone + 1))


NOT_YET = "(none yet)"


class CommandedDrone:
    """The state of one drone under a commander: its goal and its progress."""

    def __init__(self, drone: Drone, goal: str) -> None:
        """`goal` is the episode's instruction. It is valid until the commander gives another goal."""
        self.drone, self.goal = drone, goal
        self.begun = False  # the commander has replied once; until then the drone hovers
        self.since_s = 0.0  # time at which the goal was set
        self.steps = 0  # decisions since the goal was set
        # decisions in a row without a go; reset when the commander is asked about a stall
        self.steps_without_go = 0
        self.reported_s: float | None = None  # time of the drone's report of arrival; None: no report waits for a reply
        self.confirmed = False  # the report is confirmed: the drone hovers until it has another goal

    @property
    def waits(self) -> bool:
        """True while the drone hovers and waits for an order."""
        return not self.begun or self.confirmed or self.reported_s is not None

    def order(self, goal: str, now_s: float) -> None:
        """Set a goal. If the drone has reported its arrival, the same goal again rejects the report."""
        if goal != self.goal or self.confirmed:
            self.goal, self.since_s, self.steps = goal, now_s, 0
        self.steps_without_go, self.reported_s, self.confirmed = 0, None, False

    def note(self, went: bool, reported: bool, now_s: float) -> None:
        """Count a decision under the present goal. `went`: the decision is a go; `reported`: it reports the arrival."""
        self.steps += 1
        self.steps_without_go = 0 if went else self.steps_without_go + 1
        if reported:
            self.reported_s = now_s


def roster(posts: Sequence[CommandedDrone], now_s: float) -> str:
    """Return the states of all drones (`posts`), in the order of the drones, as text for the commander's prompt."""
    return "\n\n".join(_roster_entry(post, place, now_s) for place, post in enumerate(posts, 1))


def _roster_entry(post: CommandedDrone, place: int, now_s: float) -> str:
    camera, actions = post.drone.history.camera, post.drone.history.actions
    done = "; ".join(compact(action, camera) for action in actions) or NOT_YET
    return (
        f"Drone {place}\n"
        f"- goal, for {now_s - post.since_s:.0f} s and {post.steps} steps: {post.goal}\n"
        f"- report: {_report(post, now_s)}\n"
        f"- where it heads: {_heading(post)}\n"
        f"- last actions, oldest first: {done}"
    )


def _report(post: CommandedDrone, now_s: float) -> str:
    if post.reported_s is not None:
        return f"says that it has arrived, {now_s - post.reported_s:.0f} s ago; it hovers and waits for your word"
    if post.confirmed:
        return "confirmed by you; it hovers and waits for another goal"
    return "none" if post.begun else "none; it hovers and waits for your first word"


def _heading(post: CommandedDrone) -> str:
    """Return the destination of the last go in words, with the pilot's own estimate of the distance."""
    went = next((action for action in reversed(post.drone.history.actions) if isinstance(action, Go)), None)
    if went is None:
        return "nowhere yet"
    third = min(2, int(3.0 * went.x / POINT_SPAN))
    side = ("on the left of", "in the middle of", "on the right of")[third]
    return f"to something {side} its picture, {went.depth_m:.3g} m away by its own judgement"


MAX_REPLY_CHARS = 50_000  # the parser reads no more characters; eight of the longest orders are far shorter
MAX_GOAL_CHARS = 500  # as for the instruction of an episode


@dataclass(frozen=True, slots=True)
class FleetOrders:
    """The orders of one reply. Drones are counted from 0 here, and from 1 in the reply."""

    goals: tuple[tuple[int, str], ...] = ()  # (drone, its goal on one line), in the order of the reply
    confirmed: tuple[int, ...] = ()  # drones whose report is confirmed


def parse_orders(reply: str, drones: int) -> FleetOrders:
    """Return the orders in a commander's reply to a fleet of `drones`.

    The parser skips reasoning in tags such as <think>, and text around the JSON object. The last object with the key
    ORDERS or CONFIRM counts. Raises ActionError if there is no such object, or if it is malformed.
    """
    objects = [span.value for span in json_spans(answer_of(reply[:MAX_REPLY_CHARS]), "{")]
    answers = [value for value in objects if ORDERS in value or CONFIRM in value]
    if not answers:
        raise ActionError(f'no JSON object with "{ORDERS}" or "{CONFIRM}" in the reply')
    goals = tuple(_goal(order, drones) for order in _list(answers[-1], ORDERS))
    confirmed = tuple(_drone(number, drones) for number in _list(answers[-1], CONFIRM))
    counts = Counter(drone for drone, _ in goals)
    for drone, count in counts.items():
        if count > 1:
            raise ActionError(f"drone {drone + 1} has two goals")
    return FleetOrders(goals, tuple(dict.fromkeys(confirmed)))


def _list(value: dict[str, Any], key: str) -> list[Any]:
    items = value.get(key, [])
    if not isinstance(items, list):
        raise ActionError(f'"{key}" is not a list')
    return items


def _goal(order: Any, drones: int) -> tuple[int, str]:
    if not isinstance(order, dict):
        raise ActionError("an order is not a JSON object")
    goal = order.get("goal")
    if not isinstance(goal, str):
        raise ActionError('an order has no "goal" in words')
    line = " ".join(goal.split())  # a goal is one line of a prompt
    if not line or len(line) > MAX_GOAL_CHARS or not line.isprintable():
        raise ActionError(f"a goal must be 1 … {MAX_GOAL_CHARS} printable characters")
    return _drone(order.get("drone"), drones), line


def _drone(number: Any, drones: int) -> int:
    if isinstance(number, bool) or not isinstance(number, int):
        raise ActionError("a drone is not named by its number")
    if not 1 <= number <= drones:
        raise ActionError(f"there is no drone {str(number)[:20]}, but 1 to {drones}")
    return number - 1
