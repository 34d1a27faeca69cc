"""The constants of the protocol equal those of the paper and are defined in one file."""

import ast
import contextlib
from pathlib import Path

from foundation import protocol

ROOT = Path(__file__).parents[2]
NAMES = {name for name in vars(protocol) if name.isupper()}


def test_protocol_constants_equal_those_of_the_paper():
    assert (protocol.CAP_S, protocol.RADIUS_M, protocol.POSE_PERIOD_S) == (300.0, 5.0, 1 / 2)
    assert (protocol.HISTORY_LENGTH, protocol.STEP_S, protocol.STRIDE_MAX_M, protocol.SPEED_MAX) == (5, 2.5, 3.0, 1.2)
    assert (protocol.BEARING_DEADBAND_DEG, protocol.CLIMB_DEADBAND, protocol.YAW_RATE_DEG) == (8.0, 0.15, 60.0)
    assert (protocol.NEAR_M, protocol.NEAR_SCALE, protocol.BRAKE_M, protocol.STRIDE_MIN_M) == (5.0, 0.6, 2.0, 1.2)
    assert [protocol.GO, protocol.ROTATE, protocol.THINK, protocol.FINISHED] == ["go", "rotate", "think", "finished"]


def test_no_other_module_defines_a_protocol_number():
    """No other module has a constant of the same name and value. The name alone may repeat."""
    again = {
        f"{path.relative_to(ROOT)}: {name}"
        for room in ("foundation", "dronecats", "autopilot", "vehicles", "episodes", "hil")
        for path in (ROOT / room).rglob("*.py")
        if path != Path(protocol.__file__)
        for name, value in constants(path)
        if name.lstrip("_") in NAMES and value == getattr(protocol, name.lstrip("_"))
    }
    assert not again


def constants(path):
    """Yield name and value of each literal constant of a module."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            with contextlib.suppress(ValueError):
                yield node.targets[0].id, ast.literal_eval(node.value)
