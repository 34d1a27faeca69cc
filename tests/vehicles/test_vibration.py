"""The effect of unbalanced rotors on a frame and on its sensors."""

import numpy as np
import pytest

from tests.vehicles.fleet import HIGH, ORIGIN, spin
from vehicles.airframe import load, names
from vehicles.multirotor import Multirotor
from vehicles.rotor import IMBALANCE_SPEED

SECOND = 1000  # ms


def shaken(craft: Multirotor, speed: float) -> np.ndarray:
    """Hold all rotors at `speed` (rad/s) for 1 s; return the specific force of each millisecond, (n, 3)."""
    felt = np.empty((SECOND, 3))
    for k in range(SECOND):
        spin(craft, speed)
        craft.advance(1)
        felt[k] = craft.truth["accel_frd"]
    return felt


def shaking(name: str) -> Multirotor:
    """Return a vehicle high above the ground, with the rotor imbalance of its airframe."""
    return Multirotor(load(name), seed=1, origin=ORIGIN, position_ned=HIGH)


@pytest.mark.parametrize("name", names())
def test_a_hovering_frame_vibrates_at_the_rotor_frequency_and_stays_in_place(name: str) -> None:
    craft = shaking(name)
    frame, turns = craft.airframe, craft.state["rotor_turn"][: len(craft.airframe.rotors)].copy()
    felt = shaken(craft, frame.hover_speed)
    spins = np.array([rotor.spin for rotor in frame.rotors])
    one = frame.curve.rotating_kg * IMBALANCE_SPEED * frame.hover_speed / frame.mass_kg
    together = np.exp(1j * turns)
    sums = abs(together.sum()), abs((spins * together).sum()), abs(together.sum())
    for axis, share in enumerate(sums):
        line = felt[:, axis] - felt[:, axis].mean()
        power = np.abs(np.fft.rfft(line * np.hanning(SECOND)))[20:]
        assert np.argmax(power) + 20 == pytest.approx(frame.hover_speed / (2.0 * np.pi), abs=1.0)  # Hz
        assert np.sqrt(2.0) * np.std(line) == pytest.approx(share * one, rel=0.05)
    assert craft.truth["position_ned"] == pytest.approx(HIGH, abs=0.05)


def test_vibration_grows_with_the_square_of_the_rotor_speed() -> None:
    craft = shaking("x500")
    slow, fast = (np.std(shaken(craft, share * craft.airframe.hover_speed)[:, 0]) for share in (0.5, 1.0))
    assert fast / slow == pytest.approx(4.0, rel=0.05)


def test_balanced_rotors_do_not_vibrate() -> None:
    craft = Multirotor(load("x500").balanced(), seed=1, origin=ORIGIN, position_ned=HIGH)
    assert np.abs(shaken(craft, craft.airframe.hover_speed)[:, :2]).max() < 1e-9
