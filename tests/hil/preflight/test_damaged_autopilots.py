"""A vehicle with a fault fails in the row of that fault. The check changes nothing on it."""

import pytest

from foundation.errors import UsageError
from foundation.mavlink import dialect
from hil.preflight.check import apply_changes, check
from hil.preflight.failsafes import read_failsafe
from tests.hil.preflight.damaged_autopilot import HEALTHY, PREARM, STICKS

FINE = {"COM_OBL_RC_ACT = 0"}  # every autopilot of these tests fails in these rows: PX4's own default


def looked_at(link, folder):
    return check(link, seconds=1.0, folder=folder)


def failed(result):
    return {row.name for row in result.rows if row.passed is False}


def row(result, name):
    return next(row for row in result.rows if row.name == name)


def test_a_whole_one_fails_in_nothing_but_its_default_failsafe(meet, tmp_path):
    autopilot, link = meet()
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE
    assert autopilot.modes_asked[0] == "OFFBOARD"
    assert autopilot.mode == "HOLD"
    assert dialect.MAV_CMD_COMPONENT_ARM_DISARM not in autopilot.commands
    assert "PARAM_SET" not in autopilot.message_types
    assert link.listeners == []


@pytest.mark.slow
def test_no_gps(meet, tmp_path):
    _, link = meet(fix=1, health=HEALTHY & ~0x20 & ~PREARM, refuses=("OFFBOARD",), texts=("Preflight Fail: no GPS",))
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"sensors", "pre-arm check", "estimator", "GPS", "offboard rehearsal"}
    assert "Preflight Fail: no GPS" in row(result, "pre-arm check").why


@pytest.mark.slow
def test_no_home(meet, tmp_path):
    _, link = meet(home=False)
    assert failed(looked_at(link, tmp_path)) == FINE | {"home"}


@pytest.mark.slow
def test_a_mode_that_is_accepted_but_not_taken(meet, tmp_path):
    autopilot, link = meet()
    autopilot.refuses = ()
    take = autopilot._take

    def taken(message):
        take(message)
        autopilot.mode = "HOLD"

    autopilot._take = taken
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"offboard rehearsal"}
    assert "HOLD" in row(result, "offboard rehearsal").why


@pytest.mark.slow
def test_a_stream_that_does_not_come_through_is_asked_for_as_single_messages(meet, tmp_path):
    _, link = meet(withholds=("SYS_STATUS",))
    assert failed(looked_at(link, tmp_path)) == FINE


def test_setpoints_that_do_not_arrive(meet, tmp_path):
    autopilot, link = meet(deaf_to=("SET_POSITION_TARGET_LOCAL_NED",))
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"offboard rehearsal"}
    assert "arm" in row(result, "offboard rehearsal").why
    assert autopilot.mode == "HOLD"


@pytest.mark.slow
def test_no_way_back_from_offboard(meet, tmp_path):
    _, link = meet(refuses=("HOLD",))
    assert failed(looked_at(link, tmp_path)) == FINE | {"offboard rehearsal"}


@pytest.mark.slow
def test_an_armed_vehicle_is_left_alone(meet, tmp_path):
    autopilot, link = meet(armed=True)
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"disarmed", "offboard rehearsal"}
    assert autopilot.modes_asked == []
    assert "SET_POSITION_TARGET_LOCAL_NED" not in autopilot.message_types
    with pytest.raises(UsageError, match="armed"):
        apply_changes(link, result, result.changes)
    assert "PARAM_SET" not in autopilot.message_types


@pytest.mark.slow
def test_parameters_that_nobody_tells_are_a_failure_where_they_are_vital(meet, tmp_path):
    _, link = meet(parameters={}, tells_unknown=False)
    result = looked_at(link, tmp_path)
    assert failed(result) == {"COM_OBL_RC_ACT", "COM_OF_LOSS_T"}
    assert result.changes == []


@pytest.mark.slow
def test_an_old_and_an_unknown_firmware(meet, tmp_path):
    _, link = meet(version=1 << 24 | 12 << 16 | 3 << 8 | 255)
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"firmware", "COM_RCL_EXCEPT = 0"}
    assert "1.12.3" in row(result, "firmware").why


@pytest.mark.slow
def test_with_sticks_the_pilot_is_asked_for_switches(meet, tmp_path):
    _, link = meet(health=HEALTHY | STICKS)
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"COM_RC_OVERRIDE = 1"}
    assert row(result, "sticks").passed
    assert {"mode switch", "kill switch"} <= {row.name for row in result.rows}


@pytest.mark.slow
def test_mended_parameters_are_read_back_and_others_stay_unchanged(meet, tmp_path):
    autopilot, link = meet()
    before = dict(autopilot.parameters)
    result = looked_at(link, tmp_path)
    mended = apply_changes(link, result, result.changes)
    assert failed(mended) == set()
    assert mended.changes == []
    assert autopilot.parameters == {**before, "COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": 0.5}
    assert autopilot.message_types.count("PARAM_SET") == 2


def test_the_action_after_lost_setpoints_is_read_from_the_vehicle(meet):
    autopilot, link = meet()
    assert read_failsafe(link) == "COM_OBL_RC_ACT = 0 (Position), after COM_OF_LOSS_T = 1 s"
    autopilot.parameters.clear()
    assert "unknown" in read_failsafe(link)
