"""The prompt: one template file in our own words, the only place where the action space is declared."""

import hashlib
import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from dronecats.agent.action import AxisOrder
from dronecats.border.errors import UsageError

FIELDS = ("instruction", "point_fmt", "history_len", "history")
_FIELD = re.compile("{(" + "|".join(FIELDS) + ")}")
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
        """Return the SHA-256 of the template; kept in every run."""
        return hashlib.sha256(self.template.encode()).hexdigest()

    def render(self, instruction: str, history: str, history_len: int, axis_order: AxisOrder = "xy") -> str:
        """Return the text of one step."""
        values = {
            "instruction": instruction,
            "point_fmt": _POINT_FORMAT[axis_order],
            "history_len": str(history_len),
            "history": history,
        }
        return _FIELD.sub(lambda match: values[match[1]], self.template)
