"""The preflight row for signing: a vehicle with our key must reject unsigned messages."""

import pytest

from hil.preflight.failsafes import SIGNING_RULES, Situation, findings


def signing_findings(values):
    return [found for found in findings(Situation(values)) if found.row.name.split()[0] in SIGNING_RULES]


@pytest.mark.parametrize(("value", "passed"), [(0, False), (1, True), (2, True)])
def test_a_vehicle_that_accepts_unsigned_messages_fails(value, passed):
    (finding,) = signing_findings({"MAV_SIGN_CFG": value})
    assert finding.row.passed is passed
    assert (finding.change is None) is passed


def test_an_autopilot_without_the_parameter_has_no_row():
    assert signing_findings({"MAV_SIGN_CFG": None}) == []
    assert signing_findings({}) == []
