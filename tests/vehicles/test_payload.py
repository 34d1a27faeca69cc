"""The effect of a payload on the physics, and the limit of its mass."""

import numpy as np
import pytest

from foundation.errors import UsageError
from foundation.frames import GRAVITY
from tests.vehicles.fleet import HIGH, ORIGIN, spin
from vehicles.airframe import HOVER_MAX, load, max_payload_kg, names, with_payload
from vehicles.multirotor import Multirotor
from vehicles.sensors import PERFECT


def craft(payload_kg: float) -> Multirotor:
    frame = with_payload(load("x500").balanced(), payload_kg)
    return Multirotor(frame, seed=1, origin=ORIGIN, position_ned=HIGH, suite=PERFECT)


def test_hover_thrust_grows_in_proportion_to_the_mass() -> None:
    empty, full = craft(0.0), craft(0.5)
    assert full.airframe.hover_speed**2 / empty.airframe.hover_speed**2 == pytest.approx(2.5 / 2.0)
    for speed, lift in ((empty.airframe.hover_speed, 2.0 / 2.5 * GRAVITY), (full.airframe.hover_speed, GRAVITY)):
        spin(full, speed)
        full.advance(1)
        assert full.truth["accel_frd"][2] == pytest.approx(-lift, rel=0.001)


def test_a_payload_slows_roll_and_pitch_but_not_yaw() -> None:
    frame = load("x500")
    heavy = with_payload(frame, 0.5)
    # Steiner's theorem for both masses about their common centre; the payload is halfway down to the feet
    down = frame.standing_m / 2.0
    centre = 0.5 * down / 2.5
    expected = frame.inertia_frd[0] + 2.0 * centre**2 + 0.5 * (down - centre) ** 2
    assert heavy.inertia_frd == pytest.approx((expected, expected, frame.inertia_frd[2]))
    for axis, ratio in ((0, frame.inertia_frd[0] / expected), (2, 1.0)):
        rates = []
        for each in (craft(0.0), craft(0.5)):
            each.state["external_torque"][axis] = 0.01
            each.advance(50)
            rates.append(float(each.state["rates"][axis]))
        assert rates[1] / rates[0] == pytest.approx(ratio, rel=0.01)


@pytest.mark.parametrize("name", names())
def test_payloads_that_leave_no_thrust_for_steering_are_rejected(name: str) -> None:
    frame = load(name)
    most_kg = max_payload_kg(frame)
    assert with_payload(frame, most_kg).mass_kg * GRAVITY == pytest.approx(HOVER_MAX * frame.thrust_max)
    with pytest.raises(UsageError, match=f"'{name}'"):
        with_payload(frame, 1.01 * most_kg)
    assert with_payload(frame, 0.0) is frame
    assert np.isfinite(most_kg)
