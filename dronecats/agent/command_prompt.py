"""What a commander is asked: one template file in our own words, the only place where its answer is declared."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

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
        return cls(files("dronecats.agent").joinpath("commander.txt").read_text(encoding="utf-8"))

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
    told = CAUSES[cause.why].replace("{steps}", str(STALL_STEPS)).replace("{seconds}", f"{INTERVAL_S:g}")
    return told if cause.drone is None else told.replace("{n}", str(cause.drone + 1))
