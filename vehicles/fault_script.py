"""Reads a fault script, a TOML file with the part, kind, start and end of each fault."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from foundation.errors import UsageError
from foundation.typed_file import Number, toml_table, typed
from vehicles.faults import FOR_EVER_US, Fault, fault_record
from vehicles.records import MAX_FAULTS
from vehicles.sensors import Suite

USUAL = Suite()
LONGEST_S = 1e9  # s, thirty years; keeps times within the range of the record's integers
WITH_VALUE = ("bias", "delay", "weaken")  # kinds of faults that need a value

BootSeconds = Annotated[float, Meta(ge=0.0, le=LONGEST_S, description="s since boot")]
# not `tuple[Number, Number, Number]`, because msgspec 0.22 loses the tuple's length in a union with a bounded number
# and crashes
Triple = Annotated[tuple[Number, ...], Meta(min_length=3, max_length=3)]
FaultValue = Annotated[Number | Triple | None, Meta(extra={"wrong": "is not a finite number or a list of three"})]


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultScript:
    """Content of a fault script file."""

    fault: tuple[Any, ...] = ()  # tables, which `parse` reads as `FaultEntry`


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultEntry:
    """One [[fault]] table."""

    part: str  # a key of `vehicles.faults.PARTS`
    kind: str  # a key of `vehicles.faults.KINDS`
    from_s: BootSeconds = 0.0
    until_s: BootSeconds | None = None  # None: no end
    # only for the kinds in WITH_VALUE, which need it; a single number n stands for (n, 0, 0)
    value: FaultValue = None

    @property
    def fault(self) -> Fault:
        """The fault, with its times in µs of the vehicle's clock."""
        x, y, z = self.value if isinstance(self.value, tuple) else (self.value or 0.0, 0.0, 0.0)
        until_us = FOR_EVER_US if self.until_s is None else round(self.until_s * 1e6)
        return Fault(self.part, self.kind, round(self.from_s * 1e6), until_us, (x, y, z))


def load(path: Path, rotors: int, suite: Suite = USUAL) -> list[Fault]:
    """Return the faults of a file, in the order of the file, for a vehicle with `rotors` rotors and these sensors.

    Raises UsageError that names the file, the entry and the reason.
    """
    return parse(toml_table(path, f"fault script {path}"), path.name, rotors, suite)


def parse(table: dict[str, Any], name: str, rotors: int, suite: Suite = USUAL) -> list[Fault]:
    """Return the faults that a parsed TOML table lists. `name`: the file's name in errors. Raises UsageError."""
    where = f"fault script {name}"
    entries = typed(table, FaultScript, where).fault
    if len(entries) > MAX_FAULTS:
        raise UsageError(f"{where}: it has {len(entries)} faults, but at most {MAX_FAULTS} are possible")
    faults = []
    for number, entry_table in enumerate(entries, 1):
        entry = typed(entry_table, FaultEntry, f"{where}, entry {number}")
        needs_value = entry.kind in WITH_VALUE
        if needs_value != (entry.value is not None):
            wants = "needs a 'value'" if needs_value else "takes no 'value'"
            raise UsageError(f"{where}, entry {number}: a fault of kind {entry.kind} {wants}")
        try:
            fault_record([entry.fault], rotors, suite.gps_period_us, suite.gps_age_us)
        except UsageError as error:
            raise UsageError(f"{where}, entry {number}: {error}") from None
        faults.append(entry.fault)
    return faults
