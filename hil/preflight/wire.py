"""The wire between this machine and the autopilot: the telemetry's rates, the way there and back, the two clocks."""

import statistics

from foundation.mavlink import dialect
from foundation.sensors import CALENDAR_START_US
from hil.preflight.heard import ASKED_HZ, Heard
from hil.preflight.row import Row

FLOWN_ON = (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_ATTITUDE)
RATE_LEAST = 8.0  # Hz, below which the height and place loops of the link lag more than they hold
SHARE_LEAST = 0.8  # of the rate asked for, below which it is worth a word
ROUND_TRIP_MOST = 0.5  # s: a setpoint would be half of COM_OF_LOSS_T old at its arrival
LOST_MOST = 0.35  # of the questions: one message in five is lost each way
DRIFT_MOST = 2e-3  # a quartz drifts 1e-4; a vehicle whose seconds are not ours is simulated or overloaded
CALENDAR_MOST = 2.0  # s
SIMULATED_MOST_US = 7 * 86_400_000_000  # a simulator that runs for longer than a week is rare


def rows(heard: Heard) -> list[Row]:
    """Return the rows of rates, round trip and clocks."""
    return [_rates(heard), _round_trip(heard), _clock(heard)]


def _rates(heard: Heard) -> Row:
    if heard.seconds <= 0.0:
        return Row("telemetry rates", None, "not measured")
    rates = {i: heard.counts.get(i, 0) / heard.seconds for i in ASKED_HZ}
    names = {i: dialect.mavlink_map[i].msgname for i in ASKED_HZ}
    said = {i: f"{names[i]} {rates[i]:.1f} of {ASKED_HZ[i]:g} Hz" for i in ASKED_HZ}
    slow = [said[i] for i in ASKED_HZ if rates[i] < SHARE_LEAST * ASKED_HZ[i]]
    flown = ", ".join(said[i] for i in FLOWN_ON)
    if min(rates[i] for i in FLOWN_ON) < RATE_LEAST:
        return Row("telemetry rates", False, f"{', '.join(slow)}: too slow to hold a place",
                   "a faster wire, or a higher MAV_x_RATE")  # fmt: skip
    if slow:
        return Row("telemetry rates", None, f"{flown}; short of what was asked: {', '.join(slow)}",
                   "a faster wire, or a higher MAV_x_RATE")  # fmt: skip
    return Row("telemetry rates", True, f"{flown}, and all others that were asked for")


def _round_trip(heard: Heard) -> Row:
    if not heard.sync_asked:
        return Row("round trip", None, "not measured")
    if not heard.round_trips:
        return Row("round trip", None, f"none of {heard.sync_asked} TIMESYNC questions was answered")
    lengths = sorted(trip.length_s for trip in heard.round_trips)
    lost = 1.0 - len(lengths) / heard.sync_asked
    why = f"{1e3 * statistics.median(lengths):.1f} ms, at worst {1e3 * lengths[-1]:.0f} ms"
    why += f", {100 * lost:.0f} % of {heard.sync_asked} questions not answered" if lost > 0.0 else ""
    if statistics.median(lengths) > ROUND_TRIP_MOST or lost > LOST_MOST:
        return Row("round trip", False, f"{why}: setpoints would come too late or not at all", "a better wire")
    return Row("round trip", True, why)


def _clock(heard: Heard) -> Row:
    if len(heard.round_trips) < 2:
        return Row("clocks", None, "the vehicle's was not compared with this machine's")
    first, last = _best(heard, early=True), _best(heard, early=False)
    span_ns = last[0] - first[0]
    drift = (last[1] - first[1]) / span_ns if span_ns > 0 else 0.0
    why = f"the vehicle's runs {1e6 * drift:+.0f} µs a second beside this machine's"
    calendar = heard.message("SYSTEM_TIME")
    if is_simulated(heard):
        why += "; its calendar is a simulated one"
    elif calendar is not None and calendar.time_unix_usec:
        apart = heard.unix_s - calendar.time_unix_usec * 1e-6
        why += f"; its calendar is {abs(apart):.1f} s {'behind' if apart > 0 else 'ahead'}"
        if abs(apart) > CALENDAR_MOST:
            return Row("clocks", None, why, "set this machine's clock (NTP); logs are matched by it")
    slack = max(DRIFT_MOST, 2.0 * (first[2] + last[2]) / max(span_ns, 1))  # what the round trips leave unknown
    if abs(drift) > slack:
        return Row("clocks", None, why, "a simulation that does not run in real time? Else the autopilot is overloaded")
    return Row("clocks", True, why)


def is_simulated(heard: Heard) -> bool:
    """Return whether the calendar is that of our simulated receiver, which begins on the same day in each flight."""
    calendar = heard.message("SYSTEM_TIME")
    return calendar is not None and 0 <= calendar.time_unix_usec - CALENDAR_START_US < SIMULATED_MOST_US


def _best(heard: Heard, *, early: bool) -> tuple[int, int, int]:
    """Return (when, offset, half its uncertainty), all in ns, of the quickest round trip of one half of the watch."""
    half = len(heard.round_trips) // 2
    trips = heard.round_trips[:half] if early else heard.round_trips[half:]
    trip = min(trips, key=lambda t: t.length_s)
    return trip.asked_ns, trip.offset_ns, round(trip.length_s * 0.5e9)
