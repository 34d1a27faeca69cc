"""Motion: rotors, rigid body, drag."""

import numpy as np
import pytest

from foundation.airframe import Airframe
from foundation.frames import GRAVITY, quat_to_euler, rotate
from tests.vehicles.fleet import HIGH, spin, vehicle
from vehicles import rotor
from vehicles.airframe import names
from vehicles.multirotor import Multirotor


def steady(craft: Multirotor, speed: float | np.ndarray, steps: int) -> None:
    """Advance with the rotors held at `speed` (rad/s), independent of the battery voltage."""
    for _ in range(steps):
        spin(craft, speed)
        craft.advance(1)


@pytest.mark.parametrize("name", names())
def test_hover_thrust_holds_the_vehicle_in_place(name: str) -> None:
    craft = vehicle(name, position_ned=HIGH)
    steady(craft, craft.airframe.hover_speed, 1000)
    assert craft.truth["position_ned"] == pytest.approx(HIGH, abs=2e-3)
    assert craft.truth["accel_frd"] == pytest.approx((0.0, 0.0, -GRAVITY), abs=1e-3)
    assert craft.truth["rates_frd"] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_free_fall_without_drag_follows_gravity() -> None:
    craft = vehicle(position_ned=HIGH)
    craft.params["drag_linear"] = 0.0
    craft.params["drag_quadratic"] = 0.0
    craft.advance(1000)
    assert craft.truth["velocity_ned"][2] == pytest.approx(GRAVITY, rel=1e-9)
    assert craft.truth["position_ned"][2] == pytest.approx(-100.0 + GRAVITY / 2.0, rel=1e-9)
    assert craft.truth["accel_frd"] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)  # weightless


@pytest.mark.parametrize("name", names())
def test_drag_equals_weight_at_terminal_velocity(name: str) -> None:
    craft = vehicle(name, position_ned=(0.0, 0.0, -5000.0))
    craft.advance(40_000)
    linear, quadratic = craft.airframe.drag_linear_frd[2], craft.airframe.drag_quadratic_frd[2]
    weight = craft.airframe.mass_kg * GRAVITY
    terminal = (-linear + np.sqrt(linear**2 + 4.0 * quadratic * weight)) / (2.0 * quadratic)
    assert craft.truth["velocity_ned"][2] == pytest.approx(terminal, rel=1e-6)


def test_tumbling_keeps_energy_and_angular_momentum() -> None:
    craft = vehicle(position_ned=(0.0, 0.0, -1e5))
    craft.params["inertia"] = (0.02, 0.03, 0.045)
    craft.params["drag_linear"] = craft.params["drag_quadratic"] = 0.0
    craft.state["rates"] = (0.3, 12.0, 0.5)  # about the middle axis: unstable, flips over again and again
    inertia = craft.params["inertia"]

    def energy() -> float:
        return float(0.5 * np.sum(inertia * craft.state["rates"] ** 2))

    def momentum() -> np.ndarray:
        return np.array(rotate(tuple(craft.state["attitude"]), tuple(inertia * craft.state["rates"])))

    before, axis = energy(), momentum()
    turned = False
    for _ in range(20):
        craft.advance(500)
        turned |= craft.state["rates"][1] < 0.0
    assert turned
    assert energy() == pytest.approx(before, rel=1e-7)
    assert momentum() == pytest.approx(axis, abs=1e-5 * float(np.linalg.norm(axis)))


def test_projectile_without_drag_keeps_its_energy() -> None:
    craft = vehicle(position_ned=(0.0, 0.0, -1e4))
    craft.params["drag_linear"] = craft.params["drag_quadratic"] = 0.0
    craft.state["velocity"] = (10.0, -5.0, -20.0)

    def energy() -> float:
        return float(0.5 * np.sum(craft.state["velocity"] ** 2) - GRAVITY * craft.state["position"][2])

    before = energy()
    craft.advance(10_000)
    assert energy() == pytest.approx(before, rel=1e-10)


@pytest.mark.parametrize("name", names())
def test_faster_counter_clockwise_rotors_yaw_clockwise(name: str) -> None:
    craft = vehicle(name, position_ned=HIGH)
    spins = np.array([r.spin for r in craft.airframe.rotors])
    steady(craft, craft.airframe.hover_speed * (1.0 + 0.02 * spins), 50)
    assert craft.truth["rates_frd"][2] > 1e-3
    assert abs(craft.truth["rates_frd"][0]) < 1e-9


@pytest.mark.parametrize("name", names())
def test_motor_differences_roll_and_pitch_in_the_right_direction(name: str) -> None:
    craft = vehicle(name, position_ned=HIGH)
    left = np.array([-np.sign(r.position_frd[1]) for r in craft.airframe.rotors])
    steady(craft, craft.airframe.hover_speed * (1.0 + 0.02 * left), 50)
    assert craft.truth["rates_frd"][0] > 1e-2  # left side up: rolls right
    craft = vehicle(name, position_ned=HIGH)
    front = np.array([np.sign(r.position_frd[0]) for r in craft.airframe.rotors])
    steady(craft, craft.airframe.hover_speed * (1.0 + 0.02 * front), 50)
    assert craft.truth["rates_frd"][1] > 1e-2  # nose up


def test_roll_acceleration_is_torque_over_inertia() -> None:
    craft = vehicle(position_ned=HIGH)
    frame: Airframe = craft.airframe
    speeds = craft.airframe.hover_speed * np.array([0.98, 1.02, 1.02, 0.98])
    thrust = frame.curve.thrust_coefficient * speeds**2
    torque = -sum(t * r.position_frd[1] for t, r in zip(thrust, frame.rotors, strict=True))
    steady(craft, speeds, 5)
    assert craft.truth["rates_frd"][0] / 0.005 == pytest.approx(torque / frame.inertia_frd[0], rel=0.02)


@pytest.mark.parametrize("name", names())
def test_spin_up_and_down_follow_their_time_constants(name: str) -> None:
    craft = vehicle(name, position_ned=HIGH)
    curve, sound = craft.airframe.curve, craft.airframe.battery.cells * 3.8
    target = 0.5 * curve.speed_max

    def after(steps: int) -> float:
        for _ in range(steps):
            craft.state["voltage"] = sound
            craft.advance(1)
        return float(craft.state["rotor_speed"][0])

    craft.actuators["armed"] = 1
    craft.actuators["command"] = 0.5
    steps = round(curve.time_constant_up_s * 1000.0)
    assert after(steps) == pytest.approx(target * (1.0 - np.exp(-steps / 1000.0 / curve.time_constant_up_s)), rel=1e-6)
    after(1000)
    craft.actuators["armed"] = 0
    steps = round(curve.time_constant_down_s * 1000.0)
    assert after(steps) == pytest.approx(target * np.exp(-steps / 1000.0 / curve.time_constant_down_s), rel=1e-6)
    assert after(1000) == 0.0


def test_accelerating_rotors_turn_the_body_in_the_opposite_direction() -> None:
    craft = vehicle(position_ned=HIGH)
    craft.params["torque_coefficient"] = 1e-20  # so only the rotors' inertia has an effect
    craft.params["blade_drag"] = 0.0
    craft.actuators["armed"] = 1
    craft.actuators["command"][:2] = 0.6  # both counter-clockwise ones
    craft.params["speed_idle"] = 0.0
    craft.advance(30)
    momentum = craft.airframe.curve.inertia * craft.state["rotor_speed"][:2].sum()
    assert craft.truth["rates_frd"][2] == pytest.approx(momentum / craft.airframe.inertia_frd[2], rel=1e-3)


def test_the_gyroscopic_torque_of_the_rotors_turns_the_body() -> None:
    craft = vehicle(position_ned=HIGH)
    craft.params["torque_coefficient"] = 1e-20
    craft.params["thrust_coefficient"] = 1e-20
    craft.params["blade_drag"] = 0.0
    craft.state["rates"] = (1.0, 0.0, 0.0)
    speeds = np.array([900.0, 900.0, 0.0, 0.0])
    craft.params["speed_idle"] = 0.0
    steady(craft, speeds, 10)
    # momentum points up (-z): I·dq/dt = -(ω × h)_y = p·h_z
    h = -craft.airframe.curve.inertia * 1800.0
    assert craft.truth["rates_frd"][1] / 0.010 == pytest.approx(h / craft.airframe.inertia_frd[1], rel=0.01)


def test_thrust_falls_with_climb_and_grows_with_descent() -> None:
    still, _ = rotor.inflow_gain(0.0, 700.0, 0.127)
    climbing, torque = rotor.inflow_gain(5.0, 700.0, 0.127)
    sinking, _ = rotor.inflow_gain(-5.0, 700.0, 0.127)
    assert still == 1.0
    assert climbing < 1.0 < sinking
    assert climbing < torque < 1.0
    # the thrust is zero if the inflow equals the propeller's pitch speed
    assert rotor.inflow_gain(0.65 * 700.0 * 0.127 / np.pi, 700.0, 0.127)[0] == pytest.approx(0.0, abs=1e-12)


def test_ground_effect_fades_with_height() -> None:
    near, far = rotor.ground_gain(0.127, 0.127), rotor.ground_gain(0.6, 0.127)
    assert near == pytest.approx(1.0 / (1.0 - 1.0 / 16.0))
    assert far == 1.0
    assert rotor.ground_gain(0.0, 0.127) == rotor.ground_gain(0.5 * 0.127, 0.127)


def test_blade_and_frame_drag_slow_level_flight() -> None:
    craft = vehicle(position_ned=HIGH)
    craft.state["velocity"] = (8.0, 0.0, 0.0)
    speed = craft.airframe.hover_speed
    steady(craft, speed, 1)
    frame = craft.airframe
    blades = 4.0 * frame.curve.drag_coefficient * speed * 8.0
    body = frame.drag_linear_frd[0] * 8.0 + frame.drag_quadratic_frd[0] * 64.0
    assert craft.truth["accel_frd"][0] == pytest.approx(-(blades + body) / frame.mass_kg, rel=0.01)


def test_the_initial_yaw_is_kept() -> None:
    craft = vehicle(position_ned=HIGH, yaw=1.2)
    craft.advance(10)
    assert quat_to_euler(tuple(craft.truth["attitude"])) == pytest.approx((0.0, 0.0, 1.2), abs=1e-9)


def test_a_failed_rotor_makes_the_vehicle_tumble() -> None:
    craft = vehicle(position_ned=HIGH)
    craft.state["rotor_health"][0] = 0.0
    craft.actuators["armed"] = 1
    craft.actuators["command"][:4] = 0.7
    craft.advance(500)
    assert craft.truth["rates_frd"][0] > 1.0  # falls to the front right
    assert craft.truth["rates_frd"][1] < -1.0
