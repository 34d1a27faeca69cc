"""The preflight check of one vehicle: listens to it, reads parameters, tests Offboard, and returns rows of results.

Offboard is tested while disarmed. PX4 lets a disarmed vehicle switch to any mode, with or without setpoints. But in
OFFBOARD, the pre-arm check passes only if setpoints arrive (measured on 1.15; offboardCheck.cpp).
"""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from foundation.errors import DronecatsError, LinkError, UsageError
from foundation.mavlink import dialect
from foundation.setpoints import Velocity
from hil.link.link import Link, TakeoverError
from hil.link.parameters import Parameters, Value
from hil.preflight import failsafes, ground_side, vehicle
from hil.preflight.observation import Change, Finding, Observation, Row, RuleResult, Watch, bad, good

# PX4's defaults (parameter reference) that are unsafe for a real vehicle; a simulated PX4 has them too
PX4_DEFAULTS = {"COM_OBL_RC_ACT": 0, "COM_LOW_BAT_ACT": 0, "GF_MAX_HOR_DIST": 0, "GF_MAX_VER_DIST": 0}
NAMES = (*failsafes.PARAMETERS, *vehicle.BATTERY_PARAMETERS)


@dataclass(frozen=True, slots=True)
class Check:
    """The observations and parameters of a vehicle, and the rows and changes that follow from them."""

    observed: Observation
    values: dict[str, Value | None]  # by parameter name; None: the autopilot did not send the value
    fence_points: int | None  # points of the uploaded geofence; None: no reply
    rehearsal: Row  # result of the Offboard test
    around: tuple[Row, ...]  # rows about this machine: camera, disk

    @property
    def rows(self) -> list[Row]:
        """All rows, in the order of the table: first the vehicle, then the link and this machine."""
        return [
            *vehicle.rows(self.observed, self.values),
            *(self._shown(finding) for finding in self._findings()),
            self.rehearsal,
            *ground_side.wire_rows(self.observed),
            *self.around,
        ]

    @property
    def changes(self) -> list[Change]:
        """The proposed parameter changes."""
        return [finding.change for finding in self._findings() if finding.change is not None]

    def _shown(self, finding: Finding) -> Row:
        """Return a finding's row. A row that fails on a simulated vehicle because of PX4's default says so."""
        row, change = finding.row, finding.change
        if row.passed is not False or change is None or PX4_DEFAULTS.get(change.name) != change.old:
            return row
        if not ground_side.is_simulated(self.observed):
            return row
        return replace(row, why=f"{row.why}. This is normal for a simulated vehicle, which has PX4's default")

    def _findings(self) -> list[Finding]:
        version = vehicle.version(self.observed)
        situation = failsafes.Situation(
            self.values, self.observed.sticks, version, self.observed.station, self.fence_points
        )
        return failsafes.findings(situation)


def check(link: Link, *, seconds: float, folder: Path, camera_url: str | None = None) -> Check:
    """Return the check of the vehicle on a connected link. Listens for `seconds`; the other tests follow. Never arms.

    Raises LinkError if the vehicle disappears meanwhile.
    """
    observed = Watch(link).listen(seconds)
    names = (*NAMES, *(failsafes.SIGNING_RULES if link.has_key else ()))
    values, points = Parameters(link).read_many(names), failsafes.count_fence_points(link)
    rehearsal = rehearse(link)
    around = [ground_side.disk_row(folder)]
    if camera_url is not None:
        around.insert(0, ground_side.camera_row(camera_url, vehicle_clock(observed, link), link.tick, seconds))
    return Check(observed, values, points, rehearsal, tuple(around))


def vehicle_clock(observed: Observation, link: Link) -> Callable[[], int]:
    """Return the vehicle's clock in µs: this machine's clock plus the offset of the fastest TIMESYNC.

    If no TIMESYNC was answered, the clock stands at the time of the newest telemetry.
    """
    if not observed.round_trips:
        return lambda: link.time_us
    offset_ns = min(observed.round_trips, key=lambda trip: trip.length_s).offset_ns
    return lambda: (time.monotonic_ns() + offset_ns) // 1000


def apply_changes(link: Link, before: Check, changes: Sequence[Change]) -> Check:
    """Set the parameters, read each one back, and return the check with the new values.

    Raises LinkError with the first parameter that could not be set, and UsageError for a vehicle that is armed before
    or meanwhile. The changes before stay in effect.
    """
    link.await_heartbeat()  # the vehicle may have been armed while the user read the proposal
    parameters = Parameters(link)
    with _only_disarmed(link):
        for change in changes:
            _refuse_armed(link)
            parameters.set(change.name, change.new)
    return replace(before, values={**before.values, **parameters.read_many(change.name for change in changes)})


class _ArmedError(UsageError):
    """The vehicle is armed."""


def _refuse_armed(link: Link) -> None:
    if link.state.armed:
        raise _ArmedError("the vehicle is armed. Disarm it, and run this again")


@contextlib.contextmanager
def _only_disarmed(link: Link) -> Iterator[None]:
    """Raise _ArmedError if the vehicle is armed, and from the link's waits as soon as it is armed meanwhile."""
    before = link.on_wait

    def on_wait() -> None:
        before()
        _refuse_armed(link)

    _refuse_armed(link)
    link.on_wait = on_wait
    try:
        yield
    finally:
        link.on_wait = before


REHEARSAL = "offboard rehearsal"
STREAM_S = 2.0  # s of vehicle time for which setpoints are sent before the switch to OFFBOARD
SHOWN_S = 3.0  # s to wait until telemetry shows a change; some links show it only once a second, in HEARTBEAT
ZERO_VELOCITY = Velocity(forward=0.0, up=0.0)


def rehearse(link: Link) -> Row:
    """Send a velocity of zero, switch to OFFBOARD, wait for the mode, go back to HOLD; return the result as a row.

    Never arms, and does nothing with an armed vehicle. If the vehicle is armed meanwhile, sends no more setpoints and
    mode orders. Raises LinkError if the vehicle is gone.
    """
    if link.state.armed:
        return Row(REHEARSAL, False, "not done: the vehicle is armed", "disarm the vehicle first")
    try:
        with _only_disarmed(link):
            return _rehearse_disarmed(link).named(REHEARSAL)
    except (_ArmedError, TakeoverError):
        return Row(
            REHEARSAL,
            False,
            f"ended, because the vehicle was armed meanwhile; its mode is {link.state.mode}",
            "disarm the vehicle, leave it disarmed, and run this again",
        )


def _rehearse_disarmed(link: Link) -> RuleResult:
    link.fly(ZERO_VELOCITY)
    try:
        link.wait(STREAM_S)
        return _switch(link)
    finally:
        link.stop_stream()
        if not link.state.armed and link.taken_by is None:
            with contextlib.suppress(DronecatsError):  # an error of the test itself is more useful than this one
                link.set_mode("HOLD")


def _switch(link: Link) -> RuleResult:
    _refuse_armed(link)
    try:
        link.set_mode("OFFBOARD")
    except LinkError as refusal:
        link.tick()  # raises if the link is broken
        return bad(str(refusal), "PX4 needs a position, a velocity and our setpoints for it")
    shown_s = _until(link, lambda: link.state.mode == "OFFBOARD", SHOWN_S)
    if shown_s is None:
        return bad(
            f"OFFBOARD was accepted, but the mode is {link.state.mode} after {SHOWN_S:g} s",
            "check whether a transmitter or a ground station switches modes",
        )
    would_arm = _would_arm(link)
    link.stop_stream()
    _refuse_armed(link)
    try:
        link.set_mode("HOLD")
    except LinkError as refusal:
        link.tick()
        return bad(f"OFFBOARD was active, but switching back failed: {refusal}", "switch to Hold by hand")
    if _until(link, lambda: link.state.mode == "HOLD", SHOWN_S) is None:
        return bad(f"the mode is still {link.state.mode} after Hold was accepted", "switch to Hold by hand")
    if not would_arm:
        return bad(
            "OFFBOARD was active, but the vehicle would not arm in it; back in HOLD",
            "either our setpoints do not arrive, or the pre-arm check fails for another reason",
        )
    return good(f"accepted, active after {shown_s:.1f} s; the vehicle would arm in it; back in HOLD, nothing was armed")


def _would_arm(link: Link) -> bool:
    """Return whether a new SYS_STATUS within SHOWN_S shows that the pre-arm check passes."""
    checks: list[bool] = []

    def on_message(message: dialect.MAVLink_message) -> None:
        if message.get_msgId() == dialect.MAVLINK_MSG_ID_SYS_STATUS and message.get_srcSystem() == link.system:
            checks.append(bool(message.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK))

    end_us = link.time_us + SHOWN_S * 1e6
    with link.listening(on_message):
        while not any(checks) and link.time_us < end_us:
            link.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_SYS_STATUS)  # the stream may be slow
            link.tick()
    return any(checks)


def _until(link: Link, reached: Callable[[], bool], seconds: float) -> float | None:
    """Tick the link until `reached` is true; return the elapsed vehicle time (s), or None after `seconds`."""
    began_us = link.time_us
    while not reached():
        if link.time_us - began_us >= seconds * 1e6:
            return None
        link.tick()
    return (link.time_us - began_us) * 1e-6
