"""The constants of a multirotor: read by the physics, and by the autopilot's design step that turns them into gains."""

import math
from dataclasses import dataclass, replace

from foundation.frames import GRAVITY, Vec3


@dataclass(frozen=True, slots=True)
class Rotor:
    """One rotor where it sits on the airframe."""

    position_frd: Vec3  # m, hub relative to the centre of mass
    spin: int  # +1 turns counter-clockwise seen from above (its reaction torque yaws the body clockwise), -1 clockwise


@dataclass(frozen=True, slots=True)
class RotorCurve:
    """What every rotor of the airframe does with a speed command.

    An actuator command u in [0, 1] is a fraction of `speed_max`: thrust = thrust_coefficient · (u · speed_max)².
    """

    thrust_coefficient: float  # N / (rad/s)²
    torque_coefficient: float  # N·m / (rad/s)²
    speed_max: float  # rad/s at u = 1 and nominal battery voltage
    speed_idle: float  # rad/s when armed at u = 0
    time_constant_up_s: float  # s, first-order spin-up
    time_constant_down_s: float  # s, first-order spin-down
    inertia: float  # kg·m², rotor and bell about the spin axis
    radius_m: float  # m
    drag_coefficient: float  # N / ((rad/s)·(m/s)), in-plane (blade) drag
    rotating_kg: float = 0.0  # kg, propeller and bell, whose imbalance shakes the frame; 0: it does not shake


@dataclass(frozen=True, slots=True)
class Battery:
    """A LiPo pack."""

    cells: int
    capacity_ah: float
    resistance_ohm: float  # whole pack
    avionics_w: float  # constant draw beside the rotors


@dataclass(frozen=True, slots=True)
class Airframe:
    """A multirotor. Loaded from `vehicles/airframes/NAME.toml`, where each constant names its source."""

    name: str
    mass_kg: float
    inertia_frd: Vec3  # kg·m², principal moments about FRD axes
    rotors: tuple[Rotor, ...]
    curve: RotorCurve
    drag_linear_frd: Vec3  # N / (m/s), body axes
    drag_quadratic_frd: Vec3  # N / (m/s)², body axes
    contact_points_frd: tuple[Vec3, ...]  # m, feet and other points that touch the ground
    battery: Battery
    mav_type: int = 2  # MAV_TYPE: 2 quadrotor, 13 hexarotor

    @property
    def thrust_max(self) -> float:
        """N, all rotors at full speed."""
        return len(self.rotors) * self.curve.thrust_coefficient * self.curve.speed_max**2

    @property
    def hover_speed(self) -> float:
        """rad/s, of each rotor in still air."""
        return math.sqrt(self.mass_kg * GRAVITY / (len(self.rotors) * self.curve.thrust_coefficient))

    def balanced(self) -> "Airframe":
        """Return the airframe with rotors that do not shake it."""
        return replace(self, curve=replace(self.curve, rotating_kg=0.0))

    @property
    def standing_m(self) -> float:
        """m, of the body's origin above the level ground on which it stands."""
        return max(down for _, _, down in self.contact_points_frd)
