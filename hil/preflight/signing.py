"""Whether a vehicle that has our key insists on it: PX4 1.17 signs with it and still obeys everybody by default."""

from collections.abc import Mapping

from hil.link.parameters import Value
from hil.preflight.row import Change, Finding, Row

PARAMETERS = ("MAV_SIGN_CFG",)  # of PX4 from 1.17 on
OBEYS = {1: "unsigned messages are obeyed over USB only", 2: "no unsigned message is obeyed"}
NOT_USB = 1  # on every wire but USB


def findings(values: Mapping[str, Value | None]) -> list[Finding]:
    """Return whether unsigned messages are ignored; nothing when the autopilot does not tell, as ours, which does."""
    value = values.get("MAV_SIGN_CFG")
    if value is None:
        return []
    name, why = f"MAV_SIGN_CFG = {value:g}", OBEYS.get(int(value), "it has the key, and obeys unsigned messages too")
    if int(value) in OBEYS:
        return [Finding(Row(name, True, why))]
    reason = "only who has the key is obeyed, but for who holds the USB cable"
    change = Change("MAV_SIGN_CFG", value, NOT_USB, reason)
    return [Finding(Row(name, False, why, f"{NOT_USB}: --fix proposes it"), change)]
