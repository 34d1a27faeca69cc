"""Rules for PX4 parameters: all values of the enumerated parameters, with and without sticks."""

import itertools

from hil.preflight import failsafes
from hil.preflight.failsafes import FAILSAFE_RULES, FENCE_RULES, Situation, findings

SANE = {
    "COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": 0.5, "COM_RCL_EXCEPT": 0, "NAV_RCL_ACT": 2, "NAV_DLL_ACT": 2,
    "COM_LOW_BAT_ACT": 3, "COM_RC_OVERRIDE": 3, "COM_POS_FS_EPH": 5.0, "MPC_XY_VEL_MAX": 12.0,
    "MPC_Z_VEL_MAX_UP": 3.0, "MPC_Z_VEL_MAX_DN": 1.5, "SYS_HITL": 0, "COM_RC_IN_MODE": 0, "RC_MAP_FLTMODE": 5,
    "RC_MAP_KILL_SW": 6, "COM_FLTMODE1": 2, "GF_ACTION": 2, "GF_MAX_HOR_DIST": 100.0, "GF_MAX_VER_DIST": 100.0,
    "RTL_RETURN_ALT": 60.0,
}  # fmt: skip
PX4_DEFAULTS = {
    "COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 1.0, "COM_RCL_EXCEPT": 0, "NAV_RCL_ACT": 2, "NAV_DLL_ACT": 0,
    "COM_LOW_BAT_ACT": 0, "COM_RC_OVERRIDE": 1, "COM_POS_FS_EPH": 5.0, "MPC_XY_VEL_MAX": 12.0,
    "MPC_Z_VEL_MAX_UP": 3.0, "MPC_Z_VEL_MAX_DN": 1.5, "SYS_HITL": 0,
}  # fmt: skip


def judged(name, value, *, sticks=False, version=(1, 15), station=False):
    """Return (passed, proposed value) for one parameter. The proposed value is None if there is no proposal."""
    situation = Situation({name: value}, sticks, version, station)
    finding = next(f for f in findings(situation) if f.row.name.startswith(f"{name} ="))
    assert finding.row.name == f"{name} = {value:g}"
    assert finding.change is None or (finding.change.name, finding.change.old) == (name, value)
    return finding.row.passed, finding.change and finding.change.new


def test_safe_settings_pass_all_rules():
    for sticks in (False, True):
        found = findings(Situation(SANE, sticks, (1, 15), station=True))
        assert [f.change for f in found if f.change] == []
        assert [f.row for f in found if f.row.passed is False] == []
    assert all(f.row.passed for f in found)


def test_only_return_land_and_hold_are_accepted_after_lost_setpoints():
    for sticks in [False, True]:
        for value in range(8):
            expected = (True, None) if value in (3, 4, 5) else (False, 5)
            assert judged("COM_OBL_RC_ACT", value, sticks=sticks) == expected, (value, sticks)


def test_the_offboard_timeout_must_be_within_its_limits():
    for seconds, expected in [
        (0.0, (False, 0.5)), (0.2, (False, 0.5)), (0.5, (True, None)), (1.0, (True, 0.5)), (1.1, (False, 0.5)),
        (60.0, (False, 0.5)),
    ]:  # fmt: skip
        assert judged("COM_OF_LOSS_T", seconds) == expected, seconds


def test_the_stick_loss_failsafe_must_stay_on_for_a_pilot_with_sticks():
    for value in range(32):
        passed, new = judged("COM_RCL_EXCEPT", value, sticks=True)
        assert passed is not bool(value & 4), value
        assert new == (value & ~4 if value & 4 else None), value


def test_the_stick_loss_exemption_is_required_only_by_firmware_1_13_without_sticks():
    for value in range(32):
        for version in [(0, 0), (1, 13), (1, 14), (1, 15)]:
            needed = version == (1, 13) and not value & 4
            expected = (False, value | 4) if needed else (True, None)
            assert judged("COM_RCL_EXCEPT", value, version=version) == expected, (value, version)


def test_sticks_must_override_offboard_for_a_pilot_with_sticks():
    for value in range(4):
        assert judged("COM_RC_OVERRIDE", value) == (True, None), value
        expected = (True, None) if value == 3 else (False, 3)
        assert judged("COM_RC_OVERRIDE", value, sticks=True) == expected, value


def test_a_lost_link_must_not_stop_the_motors_and_no_change_is_proposed():
    for name in ["NAV_RCL_ACT", "NAV_DLL_ACT"]:
        for sticks in [False, True]:
            for value in range(7):
                passed, new = judged(name, value, sticks=sticks, station=True)
                assert new is None, (name, sticks, value)
                stops = value in (5, 6) or (name == "NAV_RCL_ACT" and sticks and value in (0, 4))
                assert (passed is False) == stops, (name, sticks, value)
    assert judged("NAV_DLL_ACT", 0)[0] is None  # no takeover is possible, so a person has to decide
    assert judged("NAV_DLL_ACT", 2)[0] is None  # the vehicle would wait for a station that never answers


def test_a_low_battery_must_trigger_a_safe_action():
    for value, expected in [
        (0, (False, 3)), (1, (True, None)), (2, (True, None)),
        (3, (True, None)), (4, (False, 3)),
    ]:  # fmt: skip
        assert judged("COM_LOW_BAT_ACT", value) == expected, value


def test_speed_limits_below_the_agents_speed_fail():
    for name in ["MPC_XY_VEL_MAX", "MPC_Z_VEL_MAX_UP", "MPC_Z_VEL_MAX_DN"]:
        assert judged(name, 1.0) == (False, None), name
        assert judged(name, 1.2) == (True, None), name


def test_the_position_error_limit_must_be_enabled_and_not_too_large():
    for value, passed in [(-1.0, False), (0.0, False), (5.0, True), (10.0, True), (50.0, False)]:
        assert judged("COM_POS_FS_EPH", value) == (passed, None), value


def test_unreadable_vital_parameters_fail():
    rows = {f.row.name: f.row.passed for f in findings(Situation(dict.fromkeys(SANE)))}
    assert [name for name, passed in rows.items() if passed is False] == ["COM_OBL_RC_ACT", "COM_OF_LOSS_T"]


def test_after_the_proposed_changes_there_are_no_further_proposals():
    for sticks, points in itertools.product((False, True), (None, 0, 4)):
        values = {**PX4_DEFAULTS, "GF_ACTION": 4, "GF_MAX_HOR_DIST": 0.0, "GF_MAX_VER_DIST": 0.0}

        def changes(values, sticks=sticks, points=points):
            situation = Situation(values, sticks, (1, 13), fence_points=points)
            return [f.change for f in findings(situation) if f.change]

        proposed = changes(values)
        assert proposed
        assert changes({**values, **{change.name: change.new for change in proposed}}) == []


def test_a_pilot_with_sticks_needs_a_switch_to_a_manual_mode():
    cases: list[tuple[dict[str, int | None], bool | None]] = [
        ({}, True), ({"RC_MAP_FLTMODE": 0}, False), ({"COM_FLTMODE1": 7}, False), ({"COM_RC_IN_MODE": 1}, None),
        ({"RC_MAP_FLTMODE": None}, None),
    ]  # fmt: skip
    for changed, passed in cases:
        rows = {f.row.name: f.row for f in findings(Situation({**SANE, **changed}, sticks=True))}
        assert rows["mode switch"].passed is passed, changed


def test_fence_rules_report_bad_settings_and_propose_safe_values():
    def fence_result(points=0, **changed):
        values = {"GF_ACTION": 2, "GF_MAX_HOR_DIST": 100.0, "GF_MAX_VER_DIST": 100.0, "RTL_RETURN_ALT": 60.0, **changed}
        found = findings(Situation(values, fence_points=points))
        rows = [f for f in found if f.row.name.split()[0] in FENCE_RULES]
        return [f.row.name.split()[0] for f in rows if f.row.passed is False], {
            f.change.name: f.change.new for f in rows if f.change
        }

    assert fence_result() == ([], {})
    assert fence_result(GF_ACTION=4) == (["GF_ACTION"], {"GF_ACTION": 2})
    assert fence_result(GF_MAX_HOR_DIST=0.0) == (["GF_MAX_HOR_DIST"], {"GF_MAX_HOR_DIST": 150.0})
    assert fence_result(GF_MAX_HOR_DIST=0.0, points=5) == ([], {})
    assert fence_result(RTL_RETURN_ALT=120.0) == (["RTL_RETURN_ALT"], {})
    assert fence_result(GF_MAX_VER_DIST=0.0) == (["GF_MAX_VER_DIST"], {"GF_MAX_VER_DIST": 120.0})
    # a ceiling below the return height would prevent the return, so the rule does not propose it
    assert fence_result(GF_MAX_VER_DIST=0.0, RTL_RETURN_ALT=130.0) == (["GF_MAX_VER_DIST"], {})


def test_every_rule_is_read_from_the_vehicle():
    assert {*FAILSAFE_RULES, *FENCE_RULES} <= set(failsafes.PARAMETERS)
    assert all(len(name) <= 16 for name in failsafes.PARAMETERS)
