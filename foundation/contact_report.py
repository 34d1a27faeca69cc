"""What the simulator says about contacts on the truth bus, as STATUSTEXT; the logger reads it."""

import re
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SaidHit:
    """A contact that began with some speed."""

    what: str  # name of what was hit
    closing_speed: float | None  # m/s; None: it was the ground
    crash: bool  # it was hard enough to break something


HIT = re.compile(r"(Collision|Crash): hit (.+?)(?: at ([\d.]+) m/s)?")
CLEAR = re.compile(r"Collision: clear after ([\d.]+) s")


def hit_text(hit: SaidHit) -> str:
    """Return the text of a hit, at most 50 bytes of UTF-8: MAVLink takes no more."""
    speed = "" if hit.closing_speed is None else f" at {hit.closing_speed:.1f} m/s"
    begin = f"{'Crash' if hit.crash else 'Collision'}: hit "
    name = hit.what.encode()[: 50 - len(begin) - len(speed)].decode(errors="ignore")
    return begin + name + speed


def clear_text(seconds: float) -> str:
    """Return the text of the end of a contact of so many seconds."""
    return f"Collision: clear after {seconds:.2f} s"


def hit_of(text: str) -> SaidHit | None:
    """Return the hit that a text tells, None for another text."""
    found = HIT.fullmatch(text)
    return found and SaidHit(found[2], float(found[3]) if found[3] else None, found[1] == "Crash")


def seconds_of(text: str) -> float | None:
    """Return the length (s) of the contact whose end a text tells, None for another text."""
    found = CLEAR.fullmatch(text)
    return float(found[1]) if found else None
