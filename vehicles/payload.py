"""What a vehicle carries: a mass fixed under its body."""

from dataclasses import replace

from foundation.airframe import Airframe
from foundation.errors import UsageError
from foundation.frames import GRAVITY

HOVER_MAX = 0.8  # of the full thrust: beyond it nothing is left to steer with, and no autopilot is designed for it


def laden(airframe: Airframe, payload_kg: float) -> Airframe:
    """Return the airframe with `payload_kg` fixed halfway down its legs, where cameras and batteries hang.

    The mass adds to the weight, and with its distance from the body's origin to the inertia of roll and pitch; a point
    on the axis adds nothing to that of yaw. Rotors and feet keep their places about the origin, so the shift of the
    centre of mass along the axis, about which the rotors' thrust has no lever, is left out. Raises UsageError for one
    with which the airframe hovers above HOVER_MAX of its thrust.
    """
    if payload_kg == 0.0:
        return airframe
    if payload_kg > (most_kg := liftable_kg(airframe)):
        raise UsageError(
            f"airframe '{airframe.name}' cannot carry {payload_kg:g} kg: with more than {most_kg:.3g} kg it would hover"
            f" above {HOVER_MAX:.0%} of its thrust"
        )
    empty_kg = airframe.mass_kg
    below_m = airframe.standing_m / 2.0
    # about the common centre of mass, by the reduced mass
    turned = payload_kg * empty_kg / (payload_kg + empty_kg) * below_m**2
    roll, pitch, yaw = airframe.inertia_frd
    return replace(airframe, mass_kg=empty_kg + payload_kg, inertia_frd=(roll + turned, pitch + turned, yaw))


def liftable_kg(airframe: Airframe) -> float:
    """Return the heaviest payload (kg) that the airframe can be flown with; 0 where it is heavy enough as it is."""
    return max(HOVER_MAX * airframe.thrust_max / GRAVITY - airframe.mass_kg, 0.0)
