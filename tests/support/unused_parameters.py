"""The parameters of the simulated autopilot that no code reads."""

import ast
import re
import textwrap
from pathlib import Path

from autopilot.parameters import DEFAULTS

ROOT = Path(__file__).parents[2]
COMPOSED = {"FD_FAIL_P_TTRI", "FD_FAIL_R_TTRI"}  # the code composes these names
INSTEAD = {
    "GF_SOURCE": "the geofence uses the estimated position, as in PX4's default",
    "GF_PREDICT": "a breach begins when the vehicle is outside the fence, as in PX4's default",
    "COM_FLTT_LOW_ACT": "the remaining flight time is not estimated; `COM_FLT_TIME_MAX` and the battery levels act",
}


def unused_parameters() -> list[str]:
    """Return the parameters whose names the autopilot and the simulator use only in the parameter table."""
    sources = [p for folder in ("autopilot", "vehicles", "dronecats/flight") for p in (ROOT / folder).rglob("*.py")]
    read = {
        word
        for path in sources
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) < 20
        for word in re.findall(r"[A-Z][A-Z0-9_]+", node.value)
        if path != ROOT / "autopilot" / "parameters.py"
    }
    return [name for name in DEFAULTS if name not in read | COMPOSED]


def section() -> str:
    """Return the part of docs/compatibility.md about these parameters."""
    rows = "\n".join(f"| `{name}` | {advice} |" for name, advice in INSTEAD.items())
    unused = unused_parameters()
    others = textwrap.fill(", ".join(f"`{name}`" for name in sorted(unused) if name not in INSTEAD), 120)
    return f"""Clients can set and read these parameters, but they have no effect:

| parameter | what the simulator does instead |
| --- | --- |
{rows}

{len(unused) - len(INSTEAD)} more parameters have no effect. They exist because clients expect them:
{others}."""
