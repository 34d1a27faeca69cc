"""Reads prompts.jsonl: the text of every question sent to a model."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision, LoggedPrompt
from foundation.run_folder.writing import NEW_LINE


@dataclass(frozen=True, slots=True)
class SentPrompt:
    """One question as it was sent. The text is `head + changed + tail`; `changed` differs from step to step."""

    row: LoggedPrompt
    head: str
    changed: str
    tail: str

    @property
    def text(self) -> str:
        return self.head + self.changed + self.tail


class PromptReader:
    """Reconstructs the texts of prompts.jsonl. Read its rows in order: a row may refer to lines of an earlier one."""

    def __init__(self) -> None:
        self._bases: dict[tuple[str, int], list[str]] = {}

    def read(self, row: LoggedPrompt) -> SentPrompt:
        """Return the question of a row. Raises UsageError for a reference to missing text."""
        if isinstance(row.text, str):
            self._bases[row.role, row.drone] = row.text.split(NEW_LINE)
            return SentPrompt(row, row.text, "", "")
        base = self._bases.get((row.role, row.drone))
        head, lines, tail = row.head or 0, row.lines or (), row.tail or 0  # UNSET (a missing field) counts as false
        if base is None or head + tail > len(base):
            raise UsageError(f"the text of question {row.number} to the {row.role} refers to lines that are missing")
        before, after = base[:head], base[len(base) - tail :]
        return SentPrompt(
            row,
            NEW_LINE.join(before) + (NEW_LINE if before and (lines or after) else ""),
            NEW_LINE.join(lines),
            (NEW_LINE if lines and after else "") + NEW_LINE.join(after),
        )


def read_prompts(folder: Path) -> tuple[SentPrompt, ...]:
    """Return the questions of an episode folder; empty without prompts.jsonl. Raises UsageError for a damaged file."""
    path = folder / layout.PROMPTS
    if not path.exists():
        return ()
    reader = PromptReader()
    try:
        return tuple(reader.read(row) for row in rows(path, LoggedPrompt))
    except UsageError as error:
        raise error if str(path) in str(error) else UsageError(f"{path} is damaged: {error}") from None


def prompts_of(decisions: Iterable[Decision], prompts: Iterable[SentPrompt]) -> dict[tuple[int, int], SentPrompt]:
    """Return the questions of decisions by (drone, step). A decision without a question has no entry.

    Question `number` n to a pilot belongs to the n-th step that this pilot answered, counted from 0. Steps that a
    commander confirms do not count, because they answer no question to a pilot.
    """
    answers: dict[int, list[int]] = defaultdict(list)  # first drone of a question → steps that answer its questions
    drones: dict[int, list[int]] = defaultdict(list)  # step → its drones
    for decision in decisions:
        if not isinstance(decision.confirmed_by, int):
            if decision.step not in drones:
                answers[decision.drone].append(decision.step)
            drones[decision.step].append(decision.drone)
    questions: dict[tuple[int, int], SentPrompt] = {}
    for prompt in prompts:
        steps = answers.get(prompt.row.drone, [])
        if prompt.row.role == "pilot" and prompt.row.number < len(steps):
            step = steps[prompt.row.number]
            questions |= {(drone, step): prompt for drone in drones[step]}
    return questions
