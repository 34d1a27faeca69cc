"""Parses the actions of a prompt's history, and writes the actions of a reply.

The agent's prompt has one line `Command: …` and a history in the compact form of the logs (paper, appendix "Execution",
History). A reply is one JSON object per drone (paper, section "Action Space").
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass

from foundation.protocol import ACTIONS, FINISHED, GO, NEAR_SCALE, POINT_SPAN, ROTATE, STRIDE_MAX_M, STRIDE_MIN_M, THINK

Pilot = Callable[[str, list[bytes]], str]  # (prompt, JPEGs in picture order) → reply

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
LEVEL_PX = 360.0  # px, row of the horizon; the history uses pixels of a 1280 × 720 picture
SHORTEST_DEPTH_M = STRIDE_MIN_M / NEAR_SCALE + 0.01  # depth of the shortest `go`, plus 1 cm for rounding

_COMMAND = re.compile(r"^[ \t]*Command:[ \t]*(.+?)[ \t]*$", re.MULTILINE)
_NUMBER = r"(-?\d+(?:\.\d+)?(?:e-?\d+)?)"
_OTHERS = "|".join(name.upper() for name in ACTIONS if name not in (GO, ROTATE))  # actions whose fields are not parsed
_PAST = re.compile(
    rf"^\s*\d+\.\s+(?:GO\s+x={_NUMBER}\s+y={_NUMBER}\s+depth={_NUMBER}m|ROTATE\s+angle={_NUMBER}deg|({_OTHERS})\b)"
)
_DRONE = re.compile(r"\bdrone\s*#?\s*(\d{1,3})\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class PastAction:
    """One action of the history, as the prompt shows it."""

    kind: str  # one of ACTIONS
    x_px: float = 0.0  # go: column of the point, px of the full picture
    y_px: float = LEVEL_PX  # go: row of the point, px of the full picture
    depth_m: float = 0.0  # go: depth of the point, m
    angle_deg: float = 0.0  # rotate: deg, positive to the right

    @property
    def is_shortest_stride(self) -> bool:
        """Whether this is the shortest stride, the last one to a target."""
        return self.kind == GO and self.depth_m <= SHORTEST_DEPTH_M + 0.1


@dataclass(frozen=True, slots=True)
class Briefing:
    """The command and the history of one prompt."""

    command: str  # the instruction; '' if the prompt has no command line
    # one entry per drone, in picture order; oldest action first; () for a drone without actions
    history: tuple[tuple[PastAction, ...], ...]

    def past(self, drone: int) -> tuple[PastAction, ...]:
        """Return the history of a drone, given its index in picture order; () if it has none."""
        return self.history[drone] if 0 <= drone < len(self.history) else ()


def read_prompt(prompt: str) -> Briefing:
    """Return the command and the histories of a prompt. Never raises; a missing part is empty.

    In a prompt for several drones, a line with the drone's number ("Drone 2") precedes each history, even an empty
    one. The pictures are in the order of the numbers.
    """
    commands = _COMMAND.findall(prompt)
    sections: dict[int, list[PastAction]] = {}
    drone = 0
    for line in prompt.splitlines():
        match = _PAST.match(line)
        if match:
            sections.setdefault(drone, []).append(_parse_action(match))
            continue
        heading = _DRONE.search(line)
        if heading:
            drone = int(heading.group(1))
            if "none yet" in line or line.rstrip().endswith(":"):
                sections.setdefault(drone, [])
    return Briefing(commands[-1] if commands else "", tuple(tuple(sections[k]) for k in sorted(sections)))


def _parse_action(match: re.Match[str]) -> PastAction:
    x, y, depth, angle, other = match.groups()
    if depth is not None:
        return PastAction(GO, x_px=float(x), y_px=float(y), depth_m=float(depth))
    if angle is not None:
        return PastAction(ROTATE, angle_deg=float(angle))
    return PastAction(other.lower())


def go(u: float, v: float, depth_m: float) -> str:
    """Return a `go` to the point (u, v), 0–1000 from the top left (clipped), at a depth in metres."""
    point = [round(min(max(u, 0.0), POINT_SPAN)), round(min(max(v, 0.0), POINT_SPAN))]
    return json.dumps({"action": GO, "point": point, "depth_m": round(depth_m, 2)})


def rotate(angle_deg: float) -> str:
    """Return a `rotate` by an angle (deg, positive to the right)."""
    return json.dumps({"action": ROTATE, "angle_deg": round(angle_deg, 1)})


def think() -> str:
    return json.dumps({"action": THINK})


def finished() -> str:
    """Return a `finished`: a declaration of arrival."""
    return json.dumps({"action": FINISHED})


def join(replies: list[str]) -> str:
    """Return the reply for all drones: one object, or a JSON array of several in picture order."""
    return replies[0] if len(replies) == 1 else "[" + ", ".join(replies) + "]"


def short_stride_m(travel_m: float) -> float:
    """Return the length (m) of the next short stride towards a place that is `travel_m` away.

    A short stride is 1.2 m to 1.8 m long. If more than 1.8 m are left, it is half of the way within these limits, so
    that the last stride is not too short.
    """
    longest = NEAR_SCALE * STRIDE_MAX_M
    return min(max(travel_m if travel_m <= longest else 0.5 * travel_m, STRIDE_MIN_M), longest)


def depth_of_stride(stride_m: float) -> float:
    """Return the depth (m) of a `go` that flies a stride of this length, but at least 1.2 m."""
    return max(stride_m, STRIDE_MIN_M) / NEAR_SCALE + 0.01
