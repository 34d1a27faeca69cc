"""A vehicle with a fault fails the row of that fault. The check changes nothing on the vehicle."""

import pytest

from foundation.errors import UsageError
from foundation.mavlink import dialect
from hil.preflight.check import apply_changes, check
from hil.preflight.failsafes import read_failsafe
from tests.hil.preflight.damaged_autopilot import HEALTHY, PREARM, STICKS

FINE = {"COM_OBL_RC_ACT = 0"}  # all autopilots of these tests fail this row, because it is PX4's default


def looked_at(link, folder):
    return check(link, seconds=1.0, folder=folder)


def failed(result):
    return {row.name for row in result.rows if row.passed is False}


def row(result, name):
    return next(row for row in result.rows if row.name == name)


def test_a_healthy_autopilot_fails_only_the_row_of_its_default_failsafe(meet, tmp_path):
    autopilot, link = meet()
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE
    assert autopilot.modes_asked[0] == "OFFBOARD"
    assert autopilot.mode == "HOLD"
    assert dialect.MAV_CMD_COMPONENT_ARM_DISARM not in autopilot.commands
    assert "PARAM_SET" not in autopilot.message_types
    assert link.listeners == []


@pytest.mark.slow
def test_a_missing_gps_fix_fails_the_rows_that_depend_on_it(meet, tmp_path):
    _, link = meet(fix=1, health=HEALTHY & ~0x20 & ~PREARM, refuses=("OFFBOARD",), texts=("Preflight Fail: no GPS",))
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"sensors", "pre-arm check", "estimator", "GPS", "offboard rehearsal"}
    assert "Preflight Fail: no GPS" in row(result, "pre-arm check").why


@pytest.mark.slow
def test_a_missing_home_position_fails_the_home_row(meet, tmp_path):
    _, link = meet(home=False)
    assert failed(looked_at(link, tmp_path)) == FINE | {"home"}


@pytest.mark.slow
def test_a_mode_change_that_is_accepted_but_not_executed_fails_the_rehearsal(meet, tmp_path):
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
def test_a_missing_stream_is_replaced_by_single_message_requests(meet, tmp_path):
    _, link = meet(withholds=("SYS_STATUS",))
    assert failed(looked_at(link, tmp_path)) == FINE


def test_setpoints_that_do_not_arrive_fail_the_rehearsal(meet, tmp_path):
    autopilot, link = meet(deaf_to=("SET_POSITION_TARGET_LOCAL_NED",))
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"offboard rehearsal"}
    assert "arm" in row(result, "offboard rehearsal").why
    assert autopilot.mode == "HOLD"


@pytest.mark.slow
def test_a_rejected_return_to_hold_fails_the_rehearsal(meet, tmp_path):
    _, link = meet(refuses=("HOLD",))
    assert failed(looked_at(link, tmp_path)) == FINE | {"offboard rehearsal"}


@pytest.mark.slow
def test_an_armed_vehicle_is_not_changed(meet, tmp_path):
    autopilot, link = meet(armed=True)
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"disarmed", "offboard rehearsal"}
    assert autopilot.modes_asked == []
    assert "SET_POSITION_TARGET_LOCAL_NED" not in autopilot.message_types
    with pytest.raises(UsageError, match="armed"):
        apply_changes(link, result, result.changes)
    assert "PARAM_SET" not in autopilot.message_types


@pytest.mark.slow
def test_only_vital_parameters_fail_if_they_cannot_be_read(meet, tmp_path):
    _, link = meet(parameters={}, tells_unknown=False)
    result = looked_at(link, tmp_path)
    assert failed(result) == {"COM_OBL_RC_ACT", "COM_OF_LOSS_T"}
    assert result.changes == []


@pytest.mark.slow
def test_an_old_firmware_fails_the_firmware_row(meet, tmp_path):
    _, link = meet(version=1 << 24 | 12 << 16 | 3 << 8 | 255)
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"firmware", "COM_RCL_EXCEPT = 0"}
    assert "1.12.3" in row(result, "firmware").why


@pytest.mark.slow
def test_with_sticks_the_check_includes_the_mode_and_kill_switches(meet, tmp_path):
    _, link = meet(health=HEALTHY | STICKS)
    result = looked_at(link, tmp_path)
    assert failed(result) == FINE | {"COM_RC_OVERRIDE = 1"}
    assert row(result, "sticks").passed
    assert {"mode switch", "kill switch"} <= {row.name for row in result.rows}


@pytest.mark.slow
def test_applied_changes_are_read_back_and_other_parameters_stay_unchanged(meet, tmp_path):
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
