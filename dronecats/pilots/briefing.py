"""What a pilot is told in words: the command and its own last actions, read back out of the prompt text.

The agent's prompt carries one line `Command: …` and a history block in the compact form of the logs
(paper, appendix "Execution", History). Everything else in the prompt is explanation, which these pilots know already.
"""

import re
from dataclasses import dataclass

from foundation.protocol import FINISHED, GO, ROTATE, THINK

_COMMAND = re.compile(r"^[ \t]*Command:[ \t]*(.+?)[ \t]*$", re.MULTILINE)
_NUMBER = r"(-?\d+(?:\.\d+)?(?:e-?\d+)?)"
_PAST = re.compile(
    rf"^\s*\d+\.\s+(?:GO\s+x={_NUMBER}\s+y={_NUMBER}\s+depth={_NUMBER}m|ROTATE\s+angle={_NUMBER}deg|(THINK)|(FINISHED))"
)
LEVEL_PX = 360.0  # the row of the horizon in those pixels
_DRONE = re.compile(r"\bdrone\s*#?\s*(\d{1,3})\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class PastAction:
    """One action of the history, as the prompt shows it."""

    kind: str  # GO, ROTATE, THINK or FINISHED
    x_px: float = 0.0  # px, of a go; the history speaks in pixels of the full picture, 1280 wide
    y_px: float = LEVEL_PX  # px, of a go
    depth_m: float = 0.0  # m, of a go
    angle_deg: float = 0.0  # deg, of a rotate, positive to the right


@dataclass(frozen=True, slots=True)
class Briefing:
    """The words of one request."""

    command: str  # the instruction; '' when the prompt has no command line
    history: tuple[tuple[PastAction, ...], ...]  # one per drone that has a history, oldest action first

    def past(self, drone: int) -> tuple[PastAction, ...]:
        """Return the history of the drone at this place in the picture order; empty when there is none."""
        return self.history[drone] if 0 <= drone < len(self.history) else ()


def read(prompt: str) -> Briefing:
    """Return the command and the histories in `prompt`. Never raises: what is not there is empty.

    Several drones have their histories under lines that name them ("Drone 2"); the order of the numbers is the order of
    the pictures.
    """
    found = _COMMAND.findall(prompt)
    sections: dict[int, list[PastAction]] = {}
    drone = 0
    for line in prompt.splitlines():
        match = _PAST.match(line)
        if match:
            sections.setdefault(drone, []).append(_past(match))
            continue
        named = _DRONE.search(line)
        if named:
            drone = int(named.group(1))
            if "none yet" in line or line.rstrip().endswith(":"):
                sections.setdefault(drone, [])
    return Briefing(found[-1] if found else "", tuple(tuple(sections[k]) for k in sorted(sections)))


def _past(match: re.Match[str]) -> PastAction:
    x, y, depth, angle, think, _finished = match.groups()
    if depth is not None:
        return PastAction(GO, x_px=float(x), y_px=float(y), depth_m=float(depth))
    if angle is not None:
        return PastAction(ROTATE, angle_deg=float(angle))
    return PastAction(THINK if think else FINISHED)
