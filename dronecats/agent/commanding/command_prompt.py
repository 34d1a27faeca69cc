"""The question to a commander: one template file in our own words, and the roster that tells it of each drone."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from dronecats.agent.action import Go
from dronecats.agent.drone import Drone
from dronecats.agent.history import compact
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
STALL_STEPS = 8  # decisions in a row without a go: more than a full circle of turns of 60°
INTERVAL_S = 45.0  # s of vehicle time between two questions, where nothing else calls for one


@dataclass(frozen=True, slots=True)
class CommandPrompt:
    """A template whose braces are literal but for its four fields."""

    template: str

    @classmethod
    def load(cls) -> "CommandPrompt":
        """Return the one that ships."""
        return cls(files("dronecats.agent.commanding").joinpath("commander.txt").read_text(encoding="utf-8"))

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the template and of the words filled in with it; kept in every run that it flies."""
        words = (self.template, FLEET, ALONE, *CAUSES.values())
        return hashlib.sha256("\0".join(words).encode()).hexdigest()

    def render(self, instruction: str, roster: str, causes: Sequence[Cause], drones: int) -> str:
        """Return the text of one question."""
        values = {
            "drones": FLEET.replace("{n}", str(drones)) if drones > 1 else ALONE,
            "instruction": instruction,
            "causes": "\n".join(said(cause) for cause in causes),
            "roster": roster,
        }
        return _FIELD.sub(lambda match: values[match[1]], self.template)


def said(cause: Cause) -> str:
    """Return a cause as the commander reads it; drones are counted from 1 there."""
    text = CAUSES[cause.why].replace("{steps}", str(STALL_STEPS)).replace("{seconds}", f"{INTERVAL_S:g}")
    return text if cause.drone is None else text.replace("{n}", str(cause.drone + 1))


NOT_YET = "(none yet)"


class Post:
    """One drone's place under a commander: its goal, and what came of it so far."""

    def __init__(self, drone: Drone, goal: str) -> None:
        """`goal` holds until another is given: the episode's own instruction."""
        self.drone, self.goal = drone, goal
        self.begun = False  # the commander has been heard; until then it hovers
        self.since_s = 0.0  # when the goal was given
        self.steps = 0  # decided since then
        self.still = 0  # of these, the last ones in a row that were no go, less those that the commander knows of
        self.reported_s: float | None = None  # when it reported its arrival, None: it has not, or has been answered
        self.confirmed = False  # its report has been; it hovers until it has another goal

    @property
    def waits(self) -> bool:
        """Whether it hovers until the commander says what is next."""
        return not self.begun or self.confirmed or self.reported_s is not None

    def order(self, goal: str, now_s: float) -> None:
        """Take a goal, the same again for a report that was not believed."""
        if goal != self.goal or self.confirmed:
            self.goal, self.since_s, self.steps = goal, now_s, 0
        self.still, self.reported_s, self.confirmed = 0, None, False

    def note(self, went: bool, reported: bool, now_s: float) -> None:
        """Take note of a decision under the present goal."""
        self.steps += 1
        self.still = 0 if went else self.still + 1
        if reported:
            self.reported_s = now_s


def roster(posts: Sequence[Post], now_s: float) -> str:
    """Return what is known of the drones, in their order, as the commander's prompt shows it."""
    return "\n\n".join(_of(post, place, now_s) for place, post in enumerate(posts, 1))


def _of(post: Post, place: int, now_s: float) -> str:
    camera, actions = post.drone.history.camera, post.drone.history.actions
    done = "; ".join(compact(action, camera) for action in actions) or NOT_YET
    return (
        f"Drone {place}\n"
        f"- goal, for {now_s - post.since_s:.0f} s and {post.steps} steps: {post.goal}\n"
        f"- report: {_report(post, now_s)}\n"
        f"- where it heads: {_heading(post)}\n"
        f"- last actions, oldest first: {done}"
    )


def _report(post: Post, now_s: float) -> str:
    if post.reported_s is not None:
        return f"says that it has arrived, {now_s - post.reported_s:.0f} s ago; it hovers and waits for your word"
    if post.confirmed:
        return "confirmed by you; it hovers and waits for another goal"
    return "none" if post.begun else "none; it hovers and waits for your first word"


def _heading(post: Post) -> str:
    """Return in words where the thing is that it last flew to, by its own judgement."""
    went = next((action for action in reversed(post.drone.history.actions) if isinstance(action, Go)), None)
    if went is None:
        return "nowhere yet"
    third = min(2, int(3.0 * went.x / POINT_SPAN))
    side = ("on the left of", "in the middle of", "on the right of")[third]
    return f"to something {side} its picture, {went.depth_m:.3g} m away by its own judgement"
