"""The mixer turns demands into rotor thrusts: exactly within the range, by priority at its limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.control.gains import CONTROL_PARAMS
from autopilot.control.mixer import allocation, mix
from foundation.airframe import Rotor
from foundation.errors import UsageError
from foundation.sensors import MAX_ROTORS
from vehicles.airframe import load, names

AIRFRAMES = {name: load(name) for name in names()}
SHARES = {name: allocation(airframe) for name, airframe in AIRFRAMES.items()}
airframe_names = st.sampled_from(sorted(AIRFRAMES))
torques = st.floats(-1.0, 1.0)
FLOOR = 0.02
unhurried = settings(deadline=None)  # the first example includes the compilation


def distribute(name, roll, pitch, yaw, thrust, airmode=0):
    """Return ((share, turn, collective), rotor fractions, normalised torques and collective of the rotors)."""
    count = len(AIRFRAMES[name].rotors)
    fractions = np.zeros(MAX_ROTORS)
    share = SHARES[name]
    params = np.zeros(1, CONTROL_PARAMS)[0]
    params["mix"], params["rotors"], params["rotor_thrust_min"], params["airmode"] = share.mix, count, FLOOR, airmode
    result = mix(params, roll, pitch, yaw, thrust, fractions)
    used, thrust_max = fractions[:count], AIRFRAMES[name].thrust_max
    made = share.effectiveness @ used * thrust_max / count / np.array([*share.torque_max, thrust_max])
    return result, used, made


@unhurried
@given(airframe_names, st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(0.35, 0.65))
def test_a_demand_within_range_is_produced_exactly(name, roll, pitch, yaw, thrust):
    result, _, made = distribute(name, roll, pitch, yaw, thrust)
    assert result == pytest.approx((1.0, 1.0, thrust))
    assert made == pytest.approx([roll, pitch, yaw, thrust], abs=1e-9)


@unhurried
@given(airframe_names, torques, torques, torques, st.floats(-0.5, 1.5), st.integers(0, 1))
def test_every_rotor_stays_in_range(name, roll, pitch, yaw, thrust, airmode):
    result, fractions, _ = distribute(name, roll, pitch, yaw, thrust, airmode)
    assert (fractions >= FLOOR).all()
    assert (fractions <= 1.0).all()
    assert 0.0 <= result[0] <= 1.0
    assert 0.0 <= result[1] <= 1.0


@unhurried
@given(airframe_names, st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), torques)
def test_at_full_thrust_roll_and_pitch_reduce_the_collective(name, roll, pitch, yaw):
    (share, _, collective), _, made = distribute(name, roll, pitch, yaw, 1.0)
    assert share == pytest.approx(1.0)
    assert made[:2] == pytest.approx([roll, pitch], abs=1e-9)
    if abs(roll) + abs(pitch) > 0.01:
        assert collective < 1.0


@unhurried
@given(airframe_names, torques, torques, torques, st.floats(0.0, 1.0), st.integers(0, 1))
def test_yaw_never_reduces_roll_pitch_or_thrust(name, roll, pitch, yaw, thrust, airmode):
    with_yaw, _, made = distribute(name, roll, pitch, yaw, thrust, airmode)
    without, _, plain = distribute(name, roll, pitch, 0.0, thrust, airmode)
    assert (with_yaw[0], with_yaw[2]) == (without[0], without[2])
    assert made[[0, 1, 3]] == pytest.approx(plain[[0, 1, 3]], abs=1e-9)


@unhurried
@given(airframe_names, torques, torques, st.floats(0.0, 0.3))
def test_thrust_rises_for_attitude_only_with_airmode(name, roll, pitch, thrust):
    (share, _, collective), _, _ = distribute(name, roll, pitch, 0.0, thrust, airmode=0)
    (share_air, _, collective_air), _, _ = distribute(name, roll, pitch, 0.0, thrust, airmode=1)
    assert collective <= max(thrust, FLOOR) + 1e-9
    assert share_air >= share - 1e-9
    assert collective_air >= collective - 1e-9


@unhurried
@given(airframe_names, torques, torques, torques, st.floats(0.0, 1.0))
def test_limited_demands_keep_their_direction(name, roll, pitch, yaw, thrust):
    (share, turn, collective), _, made = distribute(name, roll, pitch, yaw, thrust)
    assert made == pytest.approx([share * roll, share * pitch, turn * yaw, collective], abs=1e-9)


def test_geometry_that_cannot_fly_is_rejected():
    x500 = AIRFRAMES["x500"]
    in_line = tuple(Rotor((0.1 * k, 0.0, 0.0), 1 if k % 2 else -1) for k in range(-2, 3))
    with pytest.raises(UsageError, match="independent"):
        allocation(replace(x500, rotors=in_line))
    with pytest.raises(UsageError, match="rotors"):
        allocation(replace(x500, rotors=x500.rotors[:3]))
    beside = tuple(replace(r, position_frd=(r.position_frd[0] + 1.0, *r.position_frd[1:])) for r in x500.rotors)
    with pytest.raises(UsageError, match="level"):
        allocation(replace(x500, rotors=beside))
