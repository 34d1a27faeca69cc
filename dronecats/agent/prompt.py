"""The prompt: one template file in our own words, the only place where the action space is declared."""

import hashlib
import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from dronecats.agent.action import AxisOrder
from dronecats.border.errors import UsageError

FIELDS = ("instruction", "point_fmt", "history_len", "history", "situation", "answer", "closing")
_FIELD = re.compile("{(" + "|".join(FIELDS) + ")}")
ONE = {
    "situation": "You fly a multirotor. Your only sense is the picture attached to this message: the view straight"
    " ahead from the\ndrone's fixed forward camera.",
    "answer": "Answer with one JSON object and nothing else. It holds one of these four actions:",
    "closing": "One JSON object, no other text.",
}
FLEET = {
    "situation": "You fly {n} multirotors at once, Drone 1 to Drone {n}. Your only sense is the pictures attached to"
    " this message: the\nviews straight ahead from their fixed forward cameras, Drone 1's first. One drone that arrives"
    " is enough, so divide\nwhat there is to look at among them.",
    "answer": "Answer with one JSON array of {n} objects and nothing else: the actions of Drone 1 to Drone {n}, each"
    " judged in its\nown drone's picture. Every object holds one of these four actions:",
    "closing": "One JSON array of {n} objects, no other text.",
}
_POINT_FORMAT: dict[AxisOrder, str] = {"xy": "[x, y]", "yx": "[y, x]"}


@dataclass(frozen=True, slots=True)
class Prompt:
    """A template whose braces are literal but for the fields named in FIELDS."""

    template: str

    @classmethod
    def load(cls, path: Path | None = None) -> "Prompt":
        """Return the built-in prompt, or the one in `path`. Raises UsageError when it cannot be used."""
        if path is None:
            return cls(files("dronecats.agent").joinpath("prompt.txt").read_text(encoding="utf-8"))
        try:
            template = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"the prompt file {path} cannot be read: {error}") from None
        missing = [name for name in ("instruction", "history") if f"{{{name}}}" not in template]
        if missing:
            raise UsageError(f"the prompt file {path} lacks the field {{{missing[0]}}}")
        return cls(template)

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the template and of the words filled in with it; kept in every run."""
        return hashlib.sha256("\0".join((self.template, *ONE.values(), *FLEET.values())).encode()).hexdigest()

    def render(
        self, instruction: str, history: str, history_len: int, axis_order: AxisOrder = "xy", drones: int = 1
    ) -> str:
        """Return the text of one step, for one drone or for a fleet."""
        words = ONE if drones == 1 else {key: text.replace("{n}", str(drones)) for key, text in FLEET.items()}
        values = {
            **words,
            "instruction": instruction,
            "point_fmt": _POINT_FORMAT[axis_order],
            "history_len": str(history_len),
            "history": history,
        }
        return _FIELD.sub(lambda match: values[match[1]], self.template)
