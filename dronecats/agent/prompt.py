"""The prompt of a pilot: one template file, filled with the history. Only the template declares the action space."""

import hashlib
import re
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from dronecats.agent.action import POINT_FORMAT, Action, AxisOrder, Go
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.protocol import ACTIONS, HISTORY_LENGTH, POINT_SPAN
from foundation.wording import counted, suggestion

FIELDS = ("instruction", "point_fmt", "history_len", "history", "drones", "situation", "answer", "closing")
NEEDED = ("instruction", "history")
_FIELD = re.compile("{(" + "|".join(FIELDS) + ")}")
COUNT = ("four", "five", "six", "seven", "eight")[len(ACTIONS) - 4]  # number of actions in words
_LIKE_A_FIELD = re.compile(r"{([A-Za-z_]\w*)}")
SINGLE = {
    "situation": "You fly a multirotor. Your only sense is the picture attached to this message: the view straight"
    " ahead from the\ndrone's fixed forward camera.",
    "answer": f"Answer with one JSON object and nothing else. It holds one of these {COUNT} actions:",
    "closing": "One JSON object, no other text.",
}
FLEET = {
    "situation": "You fly {n} multirotors at once, Drone 1 to Drone {n}. Your only sense is the pictures attached to"
    " this message: the\nviews straight ahead from their fixed forward cameras, Drone 1's first.",
    "answer": "Answer with one JSON array of {n} objects and nothing else: the actions of Drone 1 to Drone {n}, each"
    f" judged in its\nown drone's picture. Every object holds one of these {COUNT} actions:",
    "closing": "One JSON array of {n} objects, no other text.",
}
LABEL = "Drone {n}:"  # before each picture and each history of a fleet
# text before and after a template for one drone, so that a fleet can use it
FRAMED = (
    "{situation} What follows is written for\none drone and holds for each of yours, in its own picture.\n\n",
    "\n\nWhere it asks for one object, give one JSON array of {n} such objects: the actions of Drone 1 to Drone {n}."
    "\n{closing}\n",
)
PAPER_SHA256 = (
    "aaa508bb2ea6196d2a84e7206dde5509eb967164d62ff2a37e1d26796afc81d5"  # template_sha256 of the paper's listing
)


@dataclass(frozen=True, slots=True)
class Prompt:
    """A prompt template. Braces are literal except around the names in FIELDS."""

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
        """Return the prompt of a user's template; `where` names it in errors. Raises UsageError if it is unusable."""
        for name in _LIKE_A_FIELD.findall(template):
            if name not in FIELDS:
                hint = suggestion(name, [f"{{{field}}}" for field in FIELDS], cutoff=0.6)
                raise UsageError(f"{where} has {{{name}}}, which is not a field: {hint}")
        missing = [name for name in NEEDED if f"{{{name}}}" not in template]
        if missing:
            raise UsageError(f"{where} does not have the field {{{missing[0]}}}. Add it")
        return cls(template)

    @property
    def digest(self) -> str:
        """The SHA-256 of the template and of all fixed text that fills it. run.json holds this value."""
        words = (self.template, *SINGLE.values(), *FLEET.values(), *FRAMED, LABEL)
        return hashlib.sha256("\0".join(words).encode()).hexdigest()

    @property
    def name(self) -> str:
        """Return `dronecats` for the built-in prompt, `paper` for the paper's listing, else `custom`."""
        if self == Prompt.load():
            return "dronecats"
        return "paper" if template_sha256(self.template) == PAPER_SHA256 else "custom"

    def render(
        self, instruction: str, history: str, history_len: int, axis_order: AxisOrder = "xy", drones: int = 1
    ) -> str:
        """Return the text of the question of one step, for one drone or for a fleet."""
        words = SINGLE if drones == 1 else {key: text.replace("{n}", str(drones)) for key, text in FLEET.items()}
        template = self.template
        if drones > 1 and "{answer}" not in template and "{drones}" not in template:  # not written for a fleet
            before, after = (text.replace("{n}", str(drones)) for text in FRAMED)
            template = before + template.strip() + after
        values = {
            **words,
            "instruction": instruction,
            "point_fmt": POINT_FORMAT[axis_order],
            "history_len": str(history_len),
            "history": history,
            "drones": str(drones),
        }
        return _FIELD.sub(lambda match: values[match[1]], template)


def template_sha256(template: str) -> str:
    """Return the SHA-256 of a template without white space at its ends, which editors change."""
    return hashlib.sha256(template.strip().encode()).hexdigest()


def labels(drones: int) -> tuple[str, ...]:
    """Return the labels of a fleet's pictures and histories; empty for one drone."""
    return tuple(LABEL.replace("{n}", str(place)) for place in range(1, drones + 1)) if drones > 1 else ()


# a verbatim environment of LaTeX with its options; not on a line that begins with %
_LISTING = re.compile(
    r"^[ \t]*\\begin\{(?P<name>lstlisting|verbatim|Verbatim)\}(?P<rest>.*?)^[ \t]*\\end\{(?P=name)\}", re.M | re.S
)


def prompt_listing(source: str, where: str) -> str:
    """Return the only listing of a LaTeX source that is a prompt template: one that has all fields of NEEDED.

    `where` names the source in errors. Raises UsageError if there is no such listing or more than one, and if the
    listing has an unknown field.
    """
    texts = list(_listings(source.replace("\r\n", "\n")))
    fields = [f"{{{name}}}" for name in NEEDED]
    prompts = [text for text in texts if all(field in text for field in fields)]
    if not texts:
        raise UsageError(f"{where} has no listing (lstlisting or verbatim). Give the LaTeX file that has the prompt")
    if not prompts:
        raise UsageError(
            f"{where} has {counted(len(texts), 'listing')}, none with {' and '.join(fields)};"
            " give the LaTeX file that holds the prompt"
        )
    if len(prompts) > 1:
        raise UsageError(
            f"{where} has {len(prompts)} listings that are prompts. Put one of them into a file of its own"
        )
    return Prompt.of(prompts[0], f"the listing in {where}").template


def _listings(source: str) -> Iterator[str]:
    """Yield the text of each listing without its options."""
    for match in _LISTING.finditer(source):
        rest = match["rest"]
        head, _, text = rest[_options_end(rest) :].partition("\n")
        if not head.strip():
            yield text


def _options_end(text: str) -> int:
    """Return the end of `[…]` at the beginning of a text; 0 if there is none. Brackets within braces do not count."""
    if not text.lstrip(" \t").startswith("["):
        return 0
    depth = 0
    for place, character in enumerate(text):
        depth += {"{": 1, "}": -1}.get(character, 0)
        if character == "]" and depth == 0:
            return place + 1
    return 0


NONE_YET = "(none yet — this is the first step)"  # the history at the first step


def compact(action: Action, camera: CameraModel) -> str:
    """Return the action on one line. The point of a GO is in pixels, as in the history of the paper's prompt."""
    if not isinstance(action, Go):
        return action.line
    x_px, y_px = action.x * camera.width / POINT_SPAN, action.y * camera.height / POINT_SPAN
    return f"GO x={x_px:.0f} y={y_px:.0f} depth={action.depth_m:.4g}m"


class History:
    """The last actions of one drone."""

    def __init__(self, camera: CameraModel) -> None:
        self.camera = camera
        self._actions: deque[Action] = deque(maxlen=HISTORY_LENGTH)

    def append(self, action: Action) -> None:
        self._actions.append(action)

    @property
    def actions(self) -> tuple[Action, ...]:
        """The actions, oldest first."""
        return tuple(self._actions)

    def render(self) -> str:
        """Return the actions as numbered lines, oldest first, with a mark at the newest; NONE_YET at the first step."""
        if not self._actions:
            return NONE_YET
        lines = [f"{i}. {compact(action, self.camera)}" for i, action in enumerate(self._actions, 1)]
        lines[-1] += "  <- latest"
        return "\n".join(lines)
