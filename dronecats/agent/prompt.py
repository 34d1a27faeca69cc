"""The prompt: one template file in our own words, the only place where the action space is declared."""

import difflib
import hashlib
import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from dronecats.agent.action import AxisOrder
from foundation.errors import UsageError

FIELDS = ("instruction", "point_fmt", "history_len", "history", "drones", "situation", "answer", "closing")
NEEDED = ("instruction", "history")
_FIELD = re.compile("{(" + "|".join(FIELDS) + ")}")
_LIKE_A_FIELD = re.compile(r"{([A-Za-z_]\w*)}")
ONE = {
    "situation": "You fly a multirotor. Your only sense is the picture attached to this message: the view straight"
    " ahead from the\ndrone's fixed forward camera.",
    "answer": "Answer with one JSON object and nothing else. It holds one of these four actions:",
    "closing": "One JSON object, no other text.",
}
FLEET = {
    "situation": "You fly {n} multirotors at once, Drone 1 to Drone {n}. Your only sense is the pictures attached to"
    " this message: the\nviews straight ahead from their fixed forward cameras, Drone 1's first.",
    "answer": "Answer with one JSON array of {n} objects and nothing else: the actions of Drone 1 to Drone {n}, each"
    " judged in its\nown drone's picture. Every object holds one of these four actions:",
    "closing": "One JSON array of {n} objects, no other text.",
}
LABEL = "Drone {n}:"  # before each picture of a fleet, as before each history
# around a template that knows of one drone only, so that it can be flown by a fleet
FRAMED = (
    "{situation} What follows is written for\none drone and holds for each of yours, in its own picture.\n\n",
    "\n\nWhere it asks for one object, give one JSON array of {n} such objects: the actions of Drone 1 to Drone {n}."
    "\n{closing}\n",
)
PAPER_SHA256 = (
    "aaa508bb2ea6196d2a84e7206dde5509eb967164d62ff2a37e1d26796afc81d5"  # of the paper's listing, see template_sha256
)
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
            return cls.of(path.read_text(encoding="utf-8"), f"the prompt file {path}")
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"the prompt file {path} cannot be read: {error}") from None

    @classmethod
    def of(cls, template: str, where: str) -> "Prompt":
        """Return a prompt of one's own, `where` naming it in errors. Raises UsageError when it cannot be used."""
        for name in _LIKE_A_FIELD.findall(template):
            if name not in FIELDS:
                near = difflib.get_close_matches(name, FIELDS, n=1)
                hint = f"did you mean {{{near[0]}}}?" if near else f"fields are {', '.join(FIELDS)}"
                raise UsageError(f"{where} has {{{name}}}, which is no field; {hint}")
        missing = [name for name in NEEDED if f"{{{name}}}" not in template]
        if missing:
            raise UsageError(f"{where} lacks the field {{{missing[0]}}}")
        return cls(template)

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the template and of the words filled in with it; kept in every run."""
        words = (self.template, *ONE.values(), *FLEET.values(), *FRAMED, LABEL)
        return hashlib.sha256("\0".join(words).encode()).hexdigest()

    @property
    def name(self) -> str:
        """Return `dronecats` for the prompt that ships, `paper` for the paper's listing, else `custom`."""
        if self == Prompt.load():
            return "dronecats"
        return "paper" if template_sha256(self.template) == PAPER_SHA256 else "custom"

    @property
    def knows_fleets(self) -> bool:
        """Return whether the template itself asks a fleet for an array: one that names {answer} or {drones} does."""
        return "{answer}" in self.template or "{drones}" in self.template

    def render(
        self, instruction: str, history: str, history_len: int, axis_order: AxisOrder = "xy", drones: int = 1
    ) -> str:
        """Return the text of one step, for one drone or for a fleet."""
        said = ONE if drones == 1 else {key: text.replace("{n}", str(drones)) for key, text in FLEET.items()}
        template = self.template
        if drones > 1 and not self.knows_fleets:
            before, after = (text.replace("{n}", str(drones)) for text in FRAMED)
            template = before + template.strip() + after
        values = {
            **said,
            "instruction": instruction,
            "point_fmt": _POINT_FORMAT[axis_order],
            "history_len": str(history_len),
            "history": history,
            "drones": str(drones),
        }
        return _FIELD.sub(lambda match: values[match[1]], template)


def template_sha256(template: str) -> str:
    """Return the SHA-256 of a template without the white space at its ends, which editors add and remove."""
    return hashlib.sha256(template.strip().encode()).hexdigest()


def labels(drones: int) -> tuple[str, ...]:
    """Return what stands before each picture of a fleet, and each history; of one drone nothing does."""
    return tuple(LABEL.replace("{n}", str(place)) for place in range(1, drones + 1)) if drones > 1 else ()
