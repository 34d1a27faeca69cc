"""The three plans in force. Replaced as a whole, never in part: an upload that breaks off changes nothing."""

from dataclasses import dataclass, field

from autopilot.plan.items import FENCE, KINDS, MISSION, RALLY, Item

CAPACITY = {MISSION: 1000, FENCE: 250, RALLY: 50}  # items


@dataclass(slots=True)
class Plans:
    """Items by MAV_MISSION_TYPE; `version` counts the replacements."""

    items: dict[int, tuple[Item, ...]] = field(default_factory=lambda: dict.fromkeys(KINDS, ()))
    version: int = 0

    @property
    def mission(self) -> tuple[Item, ...]:
        return self.items[MISSION]

    @property
    def fence(self) -> tuple[Item, ...]:
        return self.items[FENCE]

    @property
    def rally(self) -> tuple[Item, ...]:
        return self.items[RALLY]

    def replace(self, kind: int, items: tuple[Item, ...]) -> bool:
        """Put a plan in force. Returns whether it differs from the one before."""
        if _bits(items) == _bits(self.items[kind]):
            return False
        self.items[kind] = items
        self.version += 1
        return True


def _bits(items: tuple[Item, ...]) -> str:
    return repr(items)  # nan parameters are equal as text, and unequal as numbers
