"""The three plans in force. Replaced as a whole, never in part: an upload that breaks off changes nothing.

With a file they outlive the process, as in the memory that PX4 calls dataman: missions, geofence and rally points, and
the number of the mission's item that comes next.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from autopilot.commander.plan.checks import ACCEPTED, plan_refusal, refusal
from autopilot.commander.plan.items import FENCE, KINDS, MISSION, RALLY, PlanItem
from foundation.errors import UsageError
from foundation.whole_file import write_text

CAPACITY = {MISSION: 1000, FENCE: 250, RALLY: 50}  # items
NAMES = {MISSION: "mission", FENCE: "fence", RALLY: "rally"}


class Plans:
    """Items by MAV_MISSION_TYPE; `version` counts the replacements.

    What is put in force is kept in `file` (JSON), if given; `unsaved` is the reason why the last change could not be,
    None while all are. Raises UsageError when the file cannot be read or holds a plan that could not be uploaded.
    """

    def __init__(self, file: Path | None = None) -> None:
        self.items: dict[int, tuple[PlanItem, ...]] = dict.fromkeys(KINDS, ())
        self.version = 0
        self.current = 0  # the mission's item that comes next, as last remembered
        self.unsaved: str | None = None
        self._file = file
        if file is not None and file.exists():
            self._load(file)

    @property
    def mission(self) -> tuple[PlanItem, ...]:
        return self.items[MISSION]

    @property
    def fence(self) -> tuple[PlanItem, ...]:
        return self.items[FENCE]

    @property
    def rally(self) -> tuple[PlanItem, ...]:
        return self.items[RALLY]

    def replace(self, kind: int, items: tuple[PlanItem, ...]) -> bool:
        """Put a plan in force. Returns whether it differs from the one before."""
        if _bits(items) == _bits(self.items[kind]):
            return False
        self.items[kind] = items
        self.version += 1
        if kind == MISSION:
            self.current = 0
        self._save()
        return True

    def remember(self, current: int) -> None:
        """Keep the number of the mission's item that comes next."""
        current = current if 0 <= current < len(self.mission) else 0
        if current != self.current:
            self.current = current
            self._save()

    def _load(self, file: Path) -> None:
        try:
            stored = json.loads(file.read_text())
            for kind, name in NAMES.items():
                items = tuple(_item(entry) for entry in stored.get(name, []))
                results = [refusal(kind, item, len(items)) for item in items] + [plan_refusal(kind, items)]
                if len(items) > CAPACITY[kind] or any(result != ACCEPTED for result in results):
                    raise ValueError(f"the {name} could not be flown")
                self.items[kind] = items
            current = int(stored.get("current", 0))
        except (OSError, ValueError, TypeError, AttributeError, KeyError) as error:
            raise UsageError(
                f"The plan file {file} does not hold plans as the vehicle keeps them; correct it or delete it."
            ) from error
        self.current = current if 0 <= current < len(self.mission) else 0

    def _save(self) -> None:
        if self._file is None:
            return
        content = {name: [_entry(item) for item in self.items[kind]] for kind, name in NAMES.items()}
        try:
            write_text(self._file, json.dumps({**content, "current": self.current}, indent=1) + "\n")
            self.unsaved = None
        except OSError as error:  # a full disk is no reason to stop flying
            self.unsaved = error.strerror or "the disk refused"


def _entry(item: PlanItem) -> dict[str, Any]:
    """Return an item for the file. Numbers that JSON does not know (nan: not given) are texts."""
    numbers = [value if abs(value) < float("inf") else str(value) for value in (*item.p, item.z)]
    return {
        "command": item.command, "frame": item.frame, "p": numbers[:4], "x": item.x, "y": item.y, "z": numbers[4],
        "autocontinue": item.autocontinue,
    }  # fmt: skip


def _item(entry: Mapping[str, Any]) -> PlanItem:
    """Return the item of an entry. Raises KeyError, TypeError or ValueError for what is none."""
    whole = {name: entry[name] for name in ("command", "frame", "x", "y", "autocontinue")}
    if not all(isinstance(value, int) and abs(value) < 1 << 31 for value in whole.values()):
        raise ValueError("an item's whole numbers are not")
    a, b, c, d = (float(value) for value in entry["p"])
    return PlanItem(p=(a, b, c, d), z=float(entry["z"]), **whole)


def _bits(items: tuple[PlanItem, ...]) -> str:
    return repr(items)  # nan parameters are equal as text, and unequal as numbers
