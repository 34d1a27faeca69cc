"""The whole preflight check of one vehicle: looked at, listened to, rehearsed, and put into rows."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from foundation.errors import UsageError
from hil.link.link import Link
from hil.link.parameters import Parameters, Value
from hil.preflight import battery, camera, disk, failsafes, fence, health, position, signing, wire
from hil.preflight.heard import Heard, Watch
from hil.preflight.rehearsal import rehearse
from hil.preflight.row import Change, Finding, Row

# PX4's own values that no vehicle should fly with (its parameter reference); our simulator has them as PX4 does
PX4_DEFAULTS = {"COM_OBL_RC_ACT": 0, "COM_LOW_BAT_ACT": 0, "GF_MAX_HOR_DIST": 0, "GF_MAX_VER_DIST": 0}
NAMES = (*failsafes.PARAMETERS, *fence.PARAMETERS, *battery.PARAMETERS)


@dataclass(frozen=True, slots=True)
class Check:
    """What was found out, and what was made of it."""

    heard: Heard
    values: dict[str, Value | None]  # parameters; None where the autopilot did not tell one
    fence_points: int | None
    rehearsal: Row
    around: tuple[Row, ...]  # of this machine: camera, disk

    @property
    def rows(self) -> list[Row]:
        """Every row, in the order in which one walks around a vehicle."""
        return [
            *health.rows(self.heard),
            *position.rows(self.heard),
            battery.row(self.heard, self.values),
            *(self._shown(finding) for finding in self._findings()),
            self.rehearsal,
            *wire.rows(self.heard),
            *self.around,
        ]

    @property
    def changes(self) -> list[Change]:
        """The parameters that ought to be changed."""
        return [finding.change for finding in self._findings() if finding.change is not None]

    def _shown(self, finding: Finding) -> Row:
        """Return a finding's row; a failed one says where it is PX4's own value that our simulator has, too."""
        row, change = finding.row, finding.change
        if row.passed is not False or change is None or PX4_DEFAULTS.get(change.name) != change.old:
            return row
        if not wire.is_simulated(self.heard):
            return row
        return replace(row, why=f"{row.why}; expected here: a simulated vehicle with PX4's default")

    def _findings(self) -> list[Finding]:
        situation = failsafes.Situation(self.values, self.heard.sticks, health.version(self.heard), self.heard.station)
        return [
            *failsafes.findings(situation),
            *fence.findings(self.values, self.fence_points),
            *signing.findings(self.values),
        ]


def check(link: Link, *, seconds: float, folder: Path, camera_url: str | None = None) -> Check:
    """Return the check of the vehicle on a connected link: `seconds` of listening, and some more. Never arms.

    Raises LinkError when the vehicle goes away meanwhile.
    """
    heard = Watch(link).listen(seconds)
    names = (*NAMES, *(signing.PARAMETERS if link.has_key else ()))
    values, points = Parameters(link).read_many(names), fence.plan_size(link)
    rehearsal = rehearse(link)
    around = [] if camera_url is None else [camera.row(camera_url, vehicle_clock(heard, link), link.tick, seconds)]
    return Check(heard, values, points, rehearsal, (*around, disk.row(folder)))


def vehicle_clock(heard: Heard, link: Link) -> Callable[[], int]:
    """Return the vehicle's clock in µs, by this machine's and the offset that the quickest TIMESYNC has shown.

    Without TIMESYNC it is the clock of the newest telemetry.
    """
    if not heard.round_trips:
        return lambda: link.time_us
    offset_ns = min(heard.round_trips, key=lambda trip: trip.length_s).offset_ns
    return lambda: (time.monotonic_ns() + offset_ns) // 1000


def mend(link: Link, before: Check, changes: Sequence[Change]) -> Check:
    """Set the parameters, read each back, and return the check with the values as they are then. Changes nothing else.

    Raises LinkError naming the first that could not be set; those before it are set. UsageError for an armed vehicle.
    """
    if link.state.armed:
        raise UsageError("the vehicle is armed; parameters are only changed on one that is not: disarm it first")
    parameters = Parameters(link)
    for change in changes:
        parameters.set(change.name, change.new)
    return replace(before, values={**before.values, **parameters.read_many(change.name for change in changes)})
