"""Takes keys and the paths of one machine out of what is handed on. Pure: who calls says what is secret."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

from foundation.redaction import HIDDEN, keyless_environment, redacted, without, worth_hiding

# The shapes in which vendors hand out keys: of one that no variable of ours holds any more, nothing else tells
KEYS = re.compile(
    r"\b(?:sk-[\w-]{16,}|AIza[\w-]{30,}|(?:hf|gsk|r8|nvapi)[_-][\w-]{20,}|xai-\w{20,}|gh[pousr]_\w{30,}|AKIA[0-9A-Z]{16}"
    r"|eyJ[\w-]{10,}\.[\w-]{10,}\.[\w-]*)|(?<=Bearer )[\w.~+/-]{12,}=*"
)
_PIECE = r"[^\s/\\\"'<>|:;,()\[\]{}*?]"
PATHS = re.compile(rf"(?:file://|(?<![\w./~*:])|(?<=\w:)(?!//))/(?:{_PIECE}+/)+({_PIECE}*)")


def secrets_of(environment: Mapping[str, str]) -> tuple[str, ...]:
    """Return the values of an environment that are named as keys."""
    plain = keyless_environment(environment)
    return worth_hiding(*(value for name, value in environment.items() if name not in plain))


class Scrubber:
    """Takes out secrets, whatever has the shape of a key, and the folders of absolute paths, whose last name stays."""

    def __init__(self, secrets: Sequence[str] = (), folders: Sequence[PurePosixPath] = ()) -> None:
        self._secrets = tuple(secrets)
        longest_first = sorted({str(folder) for folder in folders if len(folder.parts) > 1}, key=len, reverse=True)
        self._folders = tuple(longest_first)

    def text(self, text: str) -> str:
        """Return a text without them."""
        text = KEYS.sub(HIDDEN, redacted(text, *self._secrets))
        for folder in self._folders:  # known ones first: they may have blanks in their names
            text = text.replace(f"{folder}/", "").replace(folder, PurePosixPath(folder).name)
        return PATHS.sub(r"\1", text)

    def lines(self, data: bytes) -> bytes:
        """Return a file of JSON lines without them; a line that holds none stays as it is, to the byte."""
        return b"\n".join(self._line(line, lambda value: json.dumps(value)) for line in data.split(b"\n"))

    def document(self, data: bytes) -> bytes:
        """Return a JSON file without them; one that holds none stays as it is, to the byte."""
        return self._line(data, lambda value: json.dumps(value, indent=2, ensure_ascii=False) + "\n")

    def _line(self, line: bytes, written: Callable[[Any], str]) -> bytes:
        text = line.decode("utf-8", "surrogateescape")
        if not self._suspect(text):
            return line
        try:
            value = json.loads(text)
            clean = self._value(value)
        except (ValueError, RecursionError):  # torn, or no JSON: as a text
            return self.text(text).encode("utf-8", "surrogateescape")
        if clean == value:
            return line
        return without(written(clean), *self._secrets).encode("utf-8", "backslashreplace")

    def _suspect(self, text: str) -> bool:
        return "/" in text or bool(KEYS.search(text)) or without(text, *self._secrets) != text

    def _value(self, value: Any) -> Any:
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, list):
            return [self._value(each) for each in value]
        if isinstance(value, dict):
            return {self.text(key): self._value(each) for key, each in value.items()}
        return value
