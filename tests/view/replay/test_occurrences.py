"""Occurrences to jump to: each event at its time, without judge data."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.view.replay.moments import Occurrence, OccurrenceKind, flight_moments, neighbour
from foundation.mavlink import MODES, Packer, dialect
from foundation.run_folder import layout
from foundation.run_folder.writing import TelemetryLog
from foundation.truth import TRUTH_COMPONENT
from tests.support.json_lines import rows

DECISION, DECLARATION, FAULT = OccurrenceKind.DECISION, OccurrenceKind.DECLARATION, OccurrenceKind.FAULT
LATER_US = 10_000_000  # µs after the flight's own messages, so additions come last


def test_decision_occurrences_equal_the_log(flight, folder):
    decisions = rows(folder / layout.DECISIONS)
    assert [occurrence.t_s for occurrence in flight.of(DECISION)] == [row["t_decided"] for row in decisions]
    assert flight.of(FAULT) == ()
    assert all("step" in occurrence.words for occurrence in flight.of(DECISION))


def test_a_declaration_and_an_unreadable_reply_are_occurrences(copied, rewrite, folder):
    last = rows(folder / layout.DECISIONS)[-1]["step"]

    def another(row):
        if row["step"] == 0:
            return {**row, "action": None, "error": "there is no JSON in it", "reply": "hm"}
        return {**row, "action": {"action": "finished"}} if row["step"] == last else row

    rewrite(copied / layout.DECISIONS, another)
    flight = flight_moments(copied)
    (declared,), (fault,) = flight.of(DECLARATION), flight.of(FAULT)
    assert str(last) in declared.words
    assert declared.drone == 0
    assert "there is no JSON in it" in fault.words
    assert fault.t_s == flight.of(DECISION)[0].t_s
    message = flight.moment(declared.t_s).judge.messages[0]
    assert flight.moment(declared.t_s - 0.01).judge.messages == ()
    frame = rows(folder / layout.TRUTH, "frame")[-1]
    assert f"{frame['distance_m']:.2f} m" in message
    (line,) = flight.moment(fault.t_s).drones[0].messages
    assert line.startswith(f"{fault.t_s:.1f} s")
    assert line.endswith(fault.words)
    assert flight.moment(fault.t_s - 0.01).drones[0].messages == ()


def test_a_period_of_envelope_limits_is_one_fault(copied):
    t0_us = rows(copied / layout.TRUTH, "begin")[0]["t0_us"]
    lines = [{"time_us": t0_us + 2_000_000, "drone": 0, "limits": ["ceiling", "speed"]},
             {"time_us": t0_us + 2_500_000, "drone": 0, "limits": ["speed"]},
             {"time_us": t0_us + 3_000_000, "drone": 0, "limits": []}]  # fmt: skip
    (copied / layout.SAFETY).write_text("".join(json.dumps(line) + "\n" for line in lines))
    (fault,) = flight_moments(copied).of(FAULT)
    assert (fault.t_s, fault.drone) == (2.0, 0)
    assert "ceiling, speed" in fault.words


@pytest.mark.parametrize("component", [1, TRUTH_COMPONENT])
def test_a_warning_is_a_fault_and_a_notice_is_not(copied, component):
    """The messages come from the autopilot, or from the simulator, which reports collisions."""
    t_s = added(copied, component, dialect.MAV_SEVERITY_WARNING, "Collision: hit a tree at 1.4 m/s")
    flight = flight_moments(copied)
    (fault,) = flight.of(FAULT)
    assert (fault.drone, fault.words) == (0, "Collision: hit a tree at 1.4 m/s")
    assert fault.t_s == pytest.approx(t_s, abs=0.05)
    added(copied, component, dialect.MAV_SEVERITY_NOTICE, "all is well")
    assert len(flight_moments(copied).of(FAULT)) == 1


def test_a_failsafe_mode_and_a_takeover_are_faults(copied, rewrite):
    mode = MODES["RETURN"]
    spliced(copied, 1, dialect.MAVLink_heartbeat_message(2, 12, 128 | 1, mode.custom_mode, 4, 3))
    rewrite(copied / layout.TRUTH, lambda row: {**row, "reason": "takeover"} if row["kind"] == "end" else row)
    flight = flight_moments(copied)
    mode_left, end = flight.of(FAULT)[0], flight.of(FAULT)[-1]
    assert "RETURN" in mode_left.words
    assert mode_left.drone == 0
    assert 1.0 < mode_left.t_s < 5.0
    assert "takeover" in end.words
    assert (end.drone, end.t_s) == (None, flight.end_s)


def added(folder, component, severity, text):
    """Add a status text of a component in the middle of the flight; return its time, s."""
    return spliced(folder, component, dialect.MAVLink_statustext_message(severity, text.encode(), 0, 0))


def spliced(folder, component, message):
    """Insert a message of vehicle 1 into the tlog, 3 s after the beginning; return that time, s."""
    begin_us = rows(folder / layout.TRUTH, "begin")[0]["t0_us"]
    data, at = (folder / layout.TLOG).read_bytes(), 0
    while int.from_bytes(data[at : at + 8], "big") < begin_us + 3_000_000:
        at += 8 + 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
    (folder / layout.TLOG).write_bytes(data[:at])
    log = TelemetryLog(folder / layout.TLOG)
    log.write(begin_us + 3_000_000, Packer(1, component).pack(message))
    log.close()
    with (folder / layout.TLOG).open("ab") as file:
        file.write(data[at:])
    return 3.0


@given(st.lists(st.floats(0.0, 300.0), max_size=20), st.floats(0.0, 300.0))
def test_the_neighbour_is_the_nearest_later_or_earlier_occurrence(times, t_s):
    occurrences = [Occurrence(t, DECISION, 0, "") for t in sorted(times)]
    ahead, back = neighbour(occurrences, t_s, True), neighbour(occurrences, t_s, False)
    assert (ahead.t_s if ahead else None) == min((t for t in times if t > t_s + 1e-6), default=None)
    assert (back.t_s if back else None) == max((t for t in times if t < t_s - 1e-6), default=None)
