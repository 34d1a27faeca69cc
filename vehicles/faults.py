"""Scheduled faults of sensors and rotors. The compiled physics looks up which faults are active at its time.

Effects of the kinds of faults:
    fail     the sensor sends no samples; the rotor stops
    freeze   the sensor continues to send samples, with the last value before the fault
    bias     `value` is added, in the sensor's unit and axes; for gps in metres north, east, down
    delay    fixes arrive `value[0]` seconds later, in addition to the receiver's latency (gps only)
    weaken   the rotor reaches only the share `value[0]` of its commanded speed
If the accelerometer or the gyroscope fails, the whole inertial unit sends no samples.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from foundation.compiled import Record, njit
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.sensors import MAX_ROTORS
from foundation.wording import suggestion
from vehicles.records import FAULTS, GPS_QUEUE, MAX_FAULTS

NONE, BIAS, DELAY, FREEZE, FAIL, WEAKEN = range(6)
KINDS = {"fail": FAIL, "freeze": FREEZE, "bias": BIAS, "delay": DELAY, "weaken": WEAKEN}

FOR_EVER_US = 2**62  # µs since boot

ACCEL, GYRO, MAG, BARO, GPS, RANGE, ROTOR_1 = range(7)
PARTS = {"accel": ACCEL, "gyro": GYRO, "mag": MAG, "baro": BARO, "gps": GPS, "range": RANGE} | {
    f"rotor{i + 1}": ROTOR_1 + i for i in range(MAX_ROTORS)
}


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of one part for a period of time."""

    part: str  # a key of PARTS; rotors count from 1 in the airframe's order
    kind: str  # a key of KINDS
    from_us: int = 0  # µs since boot
    until_us: int = FOR_EVER_US  # µs since boot
    value: Vec3 = (0.0, 0.0, 0.0)  # only the first counts for the parts baro and range, and the kinds delay and weaken


def fault_record(faults: Iterable[Fault], rotors: int, gps_period_us: int, gps_latency_us: int) -> np.void:
    """Return the FAULTS record of a script of faults. If faults of one part overlap, the first one listed is active.

    Raises UsageError for a part, kind or combination that does not exist.
    """
    record: np.void = np.zeros(1, FAULTS)[0]
    for i, fault in enumerate(faults):
        where = f"fault {fault.kind} of {fault.part}"
        if i >= MAX_FAULTS:
            raise UsageError(f"fault script: more than {MAX_FAULTS} faults. Leave some out")
        if fault.part not in PARTS or PARTS[fault.part] >= ROTOR_1 + rotors:
            names = [name for name, number in PARTS.items() if number < ROTOR_1 + rotors]
            raise UsageError(f"{where}: this vehicle has no such part: {suggestion(fault.part, names)}")
        is_rotor = PARTS[fault.part] >= ROTOR_1
        kinds = ["fail", "weaken"] if is_rotor else ["fail", "freeze", "bias"] + ["delay"] * (fault.part == "gps")
        if fault.kind not in kinds:
            raise UsageError(f"{where}: this part can only have the kinds {', '.join(kinds)}")
        if fault.until_us <= fault.from_us:
            raise UsageError(f"{where}: it must end after it begins, but it ends at {fault.until_us} µs")
        if fault.kind == "delay":
            longest = (gps_period_us * (GPS_QUEUE - 1) - gps_latency_us) * 1e-6
            if not 0.0 <= fault.value[0] <= longest:
                raise UsageError(f"{where}: the delay must be 0 to {longest:g} s, not {fault.value[0]:g} s")
        if fault.kind == "weaken" and not 0.0 <= fault.value[0] <= 1.0:
            raise UsageError(f"{where}: the share of speed must be 0 to 1, not {fault.value[0]:g}")
        record["part"][i], record["kind"][i] = PARTS[fault.part], KINDS[fault.kind]
        record["from_us"][i], record["until_us"][i] = fault.from_us, fault.until_us
        record["value"][i] = fault.value
        record["count"] = i + 1
    return record


@njit(cache=True)
def active(faults: Record, part: int, now: int) -> tuple[int, int]:
    """Return (kind, row in `faults`) of the fault of `part` that is active at `now` (µs); (NONE, 0) without one."""
    for i in range(faults.count):
        if faults.part[i] == part and faults.from_us[i] <= now < faults.until_us[i]:
            return faults.kind[i], i
    return NONE, 0


@njit(cache=True)
def apply_rotor_faults(faults: Record, state: Record, rotors: int) -> None:
    """Set the speed factor of each rotor that the script mentions; 1 while none of the rotor's faults is active."""
    for i in range(faults.count):
        rotor = faults.part[i] - ROTOR_1
        if 0 <= rotor < rotors:
            kind, row = active(faults, faults.part[i], state.time_us)
            state.rotor_fault[rotor] = 1.0 if kind == NONE else faults.value[row, 0] if kind == WEAKEN else 0.0
