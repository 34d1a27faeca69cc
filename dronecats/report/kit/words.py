"""The words of all pages for an outcome and for an action."""

import textwrap

from foundation.protocol import FINISHED, GO, ROTATE
from foundation.run_folder.rows import Decision

OUTCOMES = {  # outcome → its mark and its word
    "success": ("✓", "success"),
    "failure": ("✕", "failure"),
    "error": ("!", "error"),
    "damaged": ("!", "damaged"),
    "censored": ("?", "censored"),
    "unknown": ("?", "unknown"),
    "distance only": ("?", "distance only"),
}


def action_words(decision: Decision) -> str:
    """Return the action of a decision in a few words, such as `go (512, 700) 6.5 m` or `rotate 30° left`."""
    action = decision.action
    if action is None:
        return "no action"
    kind, point, depth_m, angle_deg = (action.get(key) for key in ("action", "point", "depth_m", "angle_deg"))
    if kind == GO and isinstance(point, list) and len(point) == 2 and isinstance(depth_m, int | float):
        return f"go ({point[0]:.0f}, {point[1]:.0f}) {depth_m:.1f} m"
    if kind == ROTATE and isinstance(angle_deg, int | float):
        return f"rotate {abs(angle_deg):.0f}° {'left' if angle_deg < 0 else 'right'}"
    return f"{FINISHED} (report)" if kind == FINISHED and decision.report is True else str(kind)


def action_or_reason(decision: Decision) -> str:
    """Return the action of a decision in a few words, or why it has none."""
    if decision.action is not None:
        return action_words(decision)
    return f"no action: {textwrap.shorten(decision.error or 'the reply holds none', 60, placeholder='…')}"
