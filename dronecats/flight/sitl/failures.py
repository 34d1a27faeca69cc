"""Applies MAVLink's failure injection to a simulated vehicle."""

from collections.abc import Iterable
from dataclasses import replace

from foundation.errors import UsageError
from foundation.mavlink import dialect
from vehicles.faults import Fault, fault_record
from vehicles.multirotor import Multirotor
from vehicles.records import FAULTS, MAX_FAULTS

SENSORS = {
    dialect.FAILURE_UNIT_SENSOR_GYRO: "gyro",
    dialect.FAILURE_UNIT_SENSOR_ACCEL: "accel",
    dialect.FAILURE_UNIT_SENSOR_MAG: "mag",
    dialect.FAILURE_UNIT_SENSOR_BARO: "baro",
    dialect.FAILURE_UNIT_SENSOR_GPS: "gps",
    dialect.FAILURE_UNIT_SENSOR_DISTANCE_SENSOR: "range",
}
KINDS = {
    dialect.FAILURE_TYPE_OFF: "fail",
    dialect.FAILURE_TYPE_STUCK: "freeze",
    dialect.FAILURE_TYPE_WRONG: "bias",
    dialect.FAILURE_TYPE_DELAYED: "delay",
}
WRONG = {  # error added by FAILURE_TYPE_WRONG: clearly visible, but plausible
    "gyro": (0.3, 0.3, 0.3),  # rad/s
    "accel": (2.0, 2.0, 2.0),  # m/s²
    "mag": (0.2, 0.2, 0.0),  # gauss
    "baro": (3.0, 0.0, 0.0),  # hPa, as for 25 m of height
    "gps": (30.0, 30.0, 0.0),  # m
    "range": (3.0, 0.0, 0.0),  # m
}
DELAY_S = 0.3  # s, GPS delay of FAILURE_TYPE_DELAYED


class Failures:
    """The failures injected into one vehicle since boot, in addition to the vehicle's fault script."""

    def __init__(self, plant: Multirotor, scripted: Iterable[Fault] = ()) -> None:
        self._plant = plant
        self._scripted = tuple(scripted)
        self._faults: dict[str, Fault] = {}

    def inject(self, unit: int, kind: int, instance: int) -> bool:
        """Apply a FAILURE_TYPE to a FAILURE_UNIT from now on; return whether it is possible. Instance 0: all parts."""
        targets = self._parts_of(unit, instance)
        if not targets or (kind != dialect.FAILURE_TYPE_OK and kind not in KINDS):
            return False
        changed = dict(self._faults)
        now = int(self._plant.state["time_us"])
        for part in targets:
            if kind == dialect.FAILURE_TYPE_OK:
                if part in changed:  # end the fault, do not remove it: the kernel restores a rotor when the fault ends
                    changed[part] = replace(changed[part], until_us=max(now, changed[part].from_us + 1))
            elif (KINDS[kind] == "delay" and part != "gps") or (part.startswith("rotor") and KINDS[kind] != "fail"):
                return False
            else:
                value = (DELAY_S, 0.0, 0.0) if KINDS[kind] == "delay" else WRONG.get(part, (0.0, 0.0, 0.0))
                changed[part] = Fault(part, KINDS[kind], from_us=now, value=value)
        if len(changed) + len(self._scripted) > MAX_FAULTS:
            return False
        if kind == dialect.FAILURE_TYPE_OK:  # also end current faults of the script, but not later faults
            self._scripted = tuple(
                replace(fault, until_us=max(now, fault.from_us + 1))
                if fault.part in targets and fault.from_us <= now < fault.until_us
                else fault
                for fault in self._scripted
            )
        before, self._faults = self._faults, changed
        try:
            self._write()
        except UsageError:  # with --gps-delay, the fixes would be older than the queue of fixes allows
            self._faults = before
            return False
        return True

    def _parts_of(self, unit: int, instance: int) -> list[str]:
        if unit in SENSORS:
            return [SENSORS[unit]] if instance in (0, 1) else []
        if unit == dialect.FAILURE_UNIT_SYSTEM_MOTOR:
            rotors = range(1, len(self._plant.airframe.rotors) + 1)
            return [f"rotor{i}" for i in rotors if instance in (0, i)]
        return []

    def _write(self) -> None:
        suite = self._plant.suite
        record = fault_record(
            (*self._faults.values(), *self._scripted),  # if a part has several faults, the first one has effect
            len(self._plant.airframe.rotors),
            int(suite["gps_period_us"]),
            int(suite["gps_latency_us"] + suite["gps_late_us"]),
        )
        for field in FAULTS.names or ():
            self._plant.faults[field] = record[field]
