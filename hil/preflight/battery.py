"""The battery: charged, measured, and of as many cells as the autopilot believes."""

from collections.abc import Mapping

from hil.link.parameters import Value
from hil.preflight.heard import Heard
from hil.preflight.row import Row

PARAMETERS = ("BAT1_N_CELLS", "BAT_LOW_THR")
CELL_LEAST, CELL_MOST = 3.5, 4.35  # V at rest: an empty lithium cell, and a full one of the high-voltage kind
MARGIN = 0.25  # of the capacity above the autopilot's own low level; a flight of five minutes takes about that
UNKNOWN = 65535


def row(heard: Heard, values: Mapping[str, Value | None]) -> Row:
    """Return the row of the battery."""
    status = heard.message("SYS_STATUS")
    if status is None or status.voltage_battery in (0, UNKNOWN):
        return Row("battery", False, "its voltage is not measured, so nobody would land before it is empty",
                   "set the battery up in the ground station")  # fmt: skip
    volts, parts = status.voltage_battery / 1000.0, []
    parts.append(f"{volts:.1f} V")
    cells = int(values.get("BAT1_N_CELLS") or 0)
    if cells > 0:
        parts.append(f"{volts / cells:.2f} V in each of {cells} cells")
    if status.battery_remaining >= 0:
        parts.append(f"{status.battery_remaining} % left")
    why = ", ".join(parts)
    if cells > 0 and not CELL_LEAST <= volts / cells <= CELL_MOST:
        return Row("battery", False, f"{why}: no resting cell has that", "charge it, or correct BAT1_N_CELLS")
    if status.battery_remaining < 0:
        return Row("battery", None, f"{why}; what is left is not told", "judge by the voltage")
    least = float(values.get("BAT_LOW_THR") or 0.15) + MARGIN
    if status.battery_remaining < 100.0 * least:
        return Row("battery", False, f"{why}: less than {100 * least:.0f} %, a flight and what must stay", "charge it")
    if not cells:
        return Row("battery", None, f"{why}; of how many cells is not told, so the voltage cannot be judged")
    return Row("battery", True, why)
