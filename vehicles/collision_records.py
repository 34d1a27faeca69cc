"""What the compiled collisions read and remember, field by field."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foundation.airframe import MAX_CONTACTS
from foundation.sensors import MAX_ROTORS

Grid32 = NDArray[np.float32]
Index = NDArray[np.int32]

BUMPERS = 2  # from rotors to the camera, of two balls each
BALLS = MAX_ROTORS + MAX_CONTACTS + 2 + 2 * BUMPERS  # rotors, feet and masts, hull, camera, bumpers
CANDIDATES = 4096  # triangles kept at hand; the thickest hedge of the maps has a quarter of that
CONTACTS = 2 * BALLS  # every ball may touch the box and one triangle

SOLIDS = np.dtype(
    [
        ("here", "i8"),  # bool: there is anything to meet
        ("balls", "i8"),
        ("ball", "f8", (BALLS, 4)),  # m, FRD centre and radius
        ("ball_rotor", "i8", (BALLS,)),  # number of the rotor whose disc it is, -1 for none
        ("ball_sound", "f8", (BALLS,)),  # m/s, fastest bump it survives
        ("reach", "f8"),  # m, from the body origin to the farthest point of any ball
        ("origin", "f8", (3,)),  # m, NED, and the rest: `border.obstacles.Obstacles`
        ("cell", "f8"),
        ("cells", "i8", (3,)),
        ("box", "i8"),  # bool: there is a moving box
        ("box_time_us", "i8"),  # µs, when the box was where the following says
        ("box_half", "f8", (3,)),  # m
        ("box_centre", "f8", (3,)),  # m, NED
        ("box_velocity", "f8", (3,)),  # m/s, NED
        ("box_yaw", "f8"),  # rad
        ("box_yaw_rate", "f8"),  # rad/s
        ("box_reach", "f8"),  # m, between the box's middle and a vehicle's origin beyond which they cannot touch
    ],
    align=True,
)

NEAR = np.dtype(
    [
        ("looked_at", "f8", (3,)),  # m, NED, position at the last look at every ball
        ("looked_from", "f8", (4,)),  # attitude then
        ("free", "f8"),  # m, way from there on which no ball can touch anything
        ("gathered_at", "f8", (3,)),  # m, NED, position for which the candidates were gathered
        ("holds", "f8"),  # m, way from there for which they are all there is
        ("candidates", "i8"),
        ("candidate", "i4", (CANDIDATES,)),  # triangle numbers
        ("box_count", "i8"),  # contacts with the box, first of those below
        ("ball", "i8", (CONTACTS,)),
        ("owner", "i8", (CONTACTS,)),
        ("depth", "f8", (CONTACTS,)),  # m, overlap
        ("normal", "f8", (CONTACTS, 3)),  # unit, NED, out of the obstacle
        ("point", "f8", (CONTACTS, 3)),  # m, NED
        ("drift", "f8", (CONTACTS, 3)),  # m/s, NED, of the obstacle there
        ("touched_us", "i8", (2 * BALLS,)),  # µs, when each ball last touched a triangle, and after these the box
        ("stiffness", "f8", (CONTACTS,)),  # N/m
        ("pressed", "f8", (CONTACTS,)),  # N·s, so far
        ("rubbed", "f8", (CONTACTS, 3)),  # N·s, NED, so far
    ],
    align=True,
)


class SolidTriangles(NamedTuple):
    """What stands, and the grid to find it in: the arrays of `foundation.obstacles.Obstacles`."""

    corners: Grid32  # (T, 9) m, NED
    bounds: Grid32  # (T, 4) m, NED, middle and radius
    start: Index  # (cells + 1,) where the numbers of each cell begin
    numbers: Index  # of the triangles, cell by cell
    owner: Index  # (T,)
