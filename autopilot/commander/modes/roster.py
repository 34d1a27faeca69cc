"""Which behaviour flies under which mode name."""

from dataclasses import dataclass

from autopilot.commander.modes.automatic import Descend, Follow, HoldMode, Land, Orbit, ReturnHome, Takeoff
from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.manual import Acro, AltitudeControl, Offboard, PositionControl, Stabilized
from autopilot.commander.modes.mission import Mission
from autopilot.records import IDLE, CascadeSetpoint


class Terminated(Mode):
    """Rotors idle."""

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        return IDLE


@dataclass(frozen=True, slots=True)
class Behaviours:
    """The modes of one vehicle; those with a target of their own also by attribute."""

    hold: HoldMode
    takeoff: Takeoff
    orbit: Orbit
    mission: Mission
    by_name: dict[str, Mode]


def behaviours() -> Behaviours:
    """Return fresh modes. PRECLAND, without a beacon to aim at, lands where it is."""
    hold, takeoff, orbit, land, stabilized = HoldMode(), Takeoff(), Orbit(), Land(), Stabilized()
    mission = Mission()
    by_name: dict[str, Mode] = {
        "HOLD": hold,
        "MISSION": mission,
        "FOLLOW": Follow(),
        "TAKEOFF": takeoff,
        "LAND": land,
        "PRECLAND": land,
        "DESCEND": Descend(),
        "RETURN": ReturnHome(),
        "ORBIT": orbit,
        "OFFBOARD": Offboard(),
        "POSCTL": PositionControl(),
        "ALTCTL": AltitudeControl(),
        "STABILIZED": stabilized,
        "MANUAL": stabilized,
        "ACRO": Acro(),
        "TERMINATION": Terminated(),
    }
    return Behaviours(hold, takeoff, orbit, mission, by_name)
