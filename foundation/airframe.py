"""Constants of a multirotor, used by the physics and by the design step that computes the autopilot's gains."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

from msgspec import Meta

from foundation.camera_mount import LEVEL, CameraMount
from foundation.frames import GRAVITY, Vec3
from foundation.sensors import MAX_ROTORS
from foundation.typed_file import NotNegative, Positive

MAX_CONTACTS = 16  # number of contact points that fit into a record of the compiled physics (`vehicles/records.py`)

CellCount = Annotated[int, Meta(gt=0, lt=1000)]
MavType = Annotated[int, Meta(gt=0, lt=1000)]


@dataclass(frozen=True, slots=True)
class Rotor:
    """Position and direction of rotation of one rotor."""

    position_frd: Vec3  # m, hub relative to the centre of mass
    spin: int  # +1: counter-clockwise seen from above (the reaction torque yaws the body clockwise); -1: clockwise


@dataclass(frozen=True, slots=True)
class RotorCurve:
    """The response of every rotor of the airframe to a speed command.

    An actuator command u in [0, 1] is a fraction of `speed_max`: thrust = thrust_coefficient · (u · speed_max)².
    """

    thrust_coefficient: Positive  # N / (rad/s)²
    torque_coefficient: Positive  # N·m / (rad/s)²
    speed_max: Positive  # rad/s at u = 1 and nominal battery voltage
    speed_idle: NotNegative  # rad/s when armed at u = 0
    time_constant_up_s: Positive  # s, first-order spin-up
    time_constant_down_s: Positive  # s, first-order spin-down
    inertia: Positive  # kg·m², rotor and bell about the spin axis
    radius_m: Positive  # m, of the propeller disc
    drag_coefficient: NotNegative  # N / ((rad/s)·(m/s)), drag of the blades in the rotor's plane
    rotating_kg: NotNegative = 0.0  # kg, propeller and bell; their imbalance shakes the frame; 0: no vibration


@dataclass(frozen=True, slots=True)
class Battery:
    """A LiPo pack."""

    cells: CellCount
    capacity_ah: Positive
    resistance_ohm: NotNegative  # of the whole pack
    avionics_w: NotNegative  # W, constant power of everything except the rotors


@dataclass(frozen=True, slots=True)
class Airframe:
    """A multirotor, read from a file like `vehicles/airframes/x500.toml`, which names the source of each constant."""

    name: str
    mass_kg: Positive
    inertia_frd: tuple[Positive, Positive, Positive]  # kg·m², principal moments about FRD axes
    rotors: Annotated[tuple[Rotor, ...], Meta(min_length=3, max_length=MAX_ROTORS)]
    curve: RotorCurve
    drag_linear_frd: tuple[NotNegative, NotNegative, NotNegative]  # N / (m/s), body axes
    drag_quadratic_frd: tuple[NotNegative, NotNegative, NotNegative]  # N / (m/s)², body axes
    # m, feet and other points that can touch the ground, relative to the centre of mass
    contact_points_frd: Annotated[tuple[Vec3, ...], Meta(min_length=3, max_length=MAX_CONTACTS)]
    battery: Battery
    mav_type: MavType = 2  # MAV_TYPE: 2 quadrotor, 13 hexarotor
    camera: CameraMount = LEVEL

    @property
    def thrust_max(self) -> float:
        """Thrust (N) of all rotors at full speed."""
        return len(self.rotors) * self.curve.thrust_coefficient * self.curve.speed_max**2

    @property
    def hover_speed(self) -> float:
        """Speed (rad/s) of each rotor at hover in still air."""
        return math.sqrt(self.mass_kg * GRAVITY / (len(self.rotors) * self.curve.thrust_coefficient))

    def balanced(self) -> "Airframe":
        """Return the airframe with perfectly balanced rotors, which do not shake it."""
        return replace(self, curve=replace(self.curve, rotating_kg=0.0))

    @property
    def standing_m(self) -> float:
        """Height (m) of the body's origin above the level ground on which the vehicle stands."""
        return max(down for _, _, down in self.contact_points_frd)
