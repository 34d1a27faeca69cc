"""Record types of the compiled physics, and the frame conversions of its kernels.

PARAMS never changes in flight. The other records are the complete state of one vehicle, so a copy of the records is a
copy of the vehicle. Sensor, actuator and truth records are in `foundation/sensors.py`.
"""

import numpy as np
from numpy.typing import NDArray

from foundation import atmosphere, frames
from foundation.airframe import MAX_CONTACTS
from foundation.compiled import njit
from foundation.frames import Vec3
from foundation.sensors import MAX_ROTORS

RandomStream = NDArray[np.uint64]  # (1,), the state of one stream of random numbers
Load = tuple[Vec3, Vec3, float]  # of the rotors: force (N, FRD), moment (N·m, FRD), angular momentum about z (N·m·s)

STEP_US = 1000  # µs, duration of a step of the physics
STEP_S = 1e-3

MAX_FAULTS = 16
GPS_QUEUE = 16  # at most this many GPS fixes wait for delivery; each waits less than this many GPS periods

PARAMS = np.dtype(
    [
        ("mass", "f8"),  # kg
        ("inertia", "f8", (3,)),  # kg·m², principal, FRD
        ("drag_linear", "f8", (3,)),  # N / (m/s), FRD
        ("drag_quadratic", "f8", (3,)),  # N / (m/s)², FRD
        ("rotors", "i8"),
        ("rotor_position", "f8", (MAX_ROTORS, 3)),  # m, FRD
        ("rotor_spin", "f8", (MAX_ROTORS,)),  # +1 counter-clockwise seen from above
        ("rotor_height", "f8"),  # m, mean height of the rotors above the body origin
        ("thrust_coefficient", "f8"),  # N / (rad/s)²
        ("torque_coefficient", "f8"),  # N·m / (rad/s)²
        ("speed_max", "f8"),  # rad/s at nominal voltage
        ("speed_idle", "f8"),  # rad/s
        ("gain_up", "f8"),  # share of a rotor's speed error that one step removes, when spinning up
        ("gain_down", "f8"),  # share when spinning down
        ("rotor_inertia", "f8"),  # kg·m²
        ("rotor_radius", "f8"),  # m
        ("blade_drag", "f8"),  # N / ((rad/s)·(m/s))
        ("imbalance", "f8"),  # kg·m, of one rotor
        ("contacts", "i8"),
        ("contact_position", "f8", (MAX_CONTACTS, 3)),  # m, FRD
        ("contact_is_foot", "i8", (MAX_CONTACTS,)),  # bool
        ("contact_stiffness", "f8"),  # N/m, one point
        ("contact_damping", "f8"),  # N·s/m, one point
        ("reach", "f8"),  # m, farthest contact point from the body origin
        ("cells", "f8"),
        ("capacity_ah", "f8"),
        ("charge_least_ah", "f8"),  # Ah, the charge never falls below this
        ("resistance_ohm", "f8"),
        ("avionics_w", "f8"),
        ("ground_north", "f8"),  # m, north of the height field's first grid point
        ("ground_east", "f8"),  # m, east of this grid point
        ("ground_cell", "f8"),  # m, side of a cell of the height field
    ],
    align=True,
)

STATE = np.dtype(
    [
        ("time_us", "i8"),  # µs since boot
        ("position", "f8", (3,)),  # m, NED
        ("velocity", "f8", (3,)),  # m/s, NED
        ("attitude", "f8", (4,)),  # (w, x, y, z), FRD → NED
        ("rates", "f8", (3,)),  # rad/s, FRD
        ("specific_force", "f8", (3,)),  # m/s², FRD, mean over the last step
        ("mean_rates", "f8", (3,)),  # rad/s, FRD, mean over the last step
        ("rotor_speed", "f8", (MAX_ROTORS,)),  # rad/s, magnitude
        ("rotor_turn", "f8", (MAX_ROTORS,)),  # rad, angle of the imbalance from forward, in the direction of rotation
        ("rotor_health", "f8", (MAX_ROTORS,)),  # factor on the commanded speed: 1 intact, 0 broken by a hit
        ("rotor_fault", "f8", (MAX_ROTORS,)),  # another such factor, by the fault script: 1 no fault … 0 failed
        ("rotor_power", "f8"),  # W, mechanical, all rotors
        ("charge_ah", "f8"),
        ("voltage", "f8"),  # V, at the terminals
        ("current", "f8"),  # A
        ("height", "f8"),  # m, body origin above the ground below it
        ("anchor", "f8", (MAX_CONTACTS, 3)),  # m, NED, place to which friction ties each contact point
        ("contact", "i8", (MAX_CONTACTS,)),  # bool: the point touches the ground
        ("carried", "f8", (4,)),  # rotors' vertical force (N) and moment (3 × N·m) when the vehicle came to rest
        ("on_ground", "i8"),  # bool: any point touches
        ("crashed", "i8"),  # bool, latched: a hit faster than CRASH_FOOT (landing feet) or CRASH_BODY (other parts)
        ("hits", "i8"),  # number of contacts with obstacles and vehicles so far that began faster than HIT_LEAST
        ("hit_speed", "f8"),  # m/s, closing speed of the last hit
        ("hit_owner", "i8"),  # index in `Obstacles.names`, `collision.BOX` or `encounter.DRONE`
        ("upside_down", "i8"),  # bool: body z axis points up
        ("external_force", "f8", (3,)),  # N, NED at the body origin, such as from other vehicles; stays until rewritten
        ("external_torque", "f8", (3,)),  # N·m, FRD
    ],
    align=True,
)

AIR = np.dtype(
    [
        ("mean", "f8", (3,)),  # m/s, NED, steady wind (the direction the air moves to)
        ("w20", "f8"),  # m/s, wind at 20 ft that sets the gust intensity; 0: no gusts
        ("gust", "f8", (3,)),  # m/s, NED, added to `mean`
        ("filter", "f8", (3, 2)),  # states of the shaping filters: along, across, vertical
        ("next_us", "i8"),  # µs of the next gust update
        ("rng", "u8", (1,)),
    ],
    align=True,
)

FAULTS = np.dtype(
    [
        ("count", "i8"),
        ("part", "i8", (MAX_FAULTS,)),  # numbers from `vehicles.faults`
        ("kind", "i8", (MAX_FAULTS,)),
        ("from_us", "i8", (MAX_FAULTS,)),
        ("until_us", "i8", (MAX_FAULTS,)),
        ("value", "f8", (MAX_FAULTS, 3)),
    ],
    align=True,
)


rotate = njit(cache=True)(frames.rotate)
rotate_inverse = njit(cache=True)(frames.rotate_inverse)
quat_normalized = njit(cache=True)(frames.quat_normalized)
ned_to_geodetic = njit(cache=True)(frames.ned_to_geodetic)
pressure = njit(cache=True)(atmosphere.pressure)
