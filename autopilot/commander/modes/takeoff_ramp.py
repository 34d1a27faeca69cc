"""Leaving the ground: rotors idle until a mode wants to climb, then thrust is let in over MPC_TKO_RAMP_T.

As in PX4's take-off handling: spool-up, ready, ramp, flight. Attitude and rate setpoints pass: their thrust is the
pilot's own.
"""

import math

from autopilot.commander.modes.setpoint import IDLE, NAN, CascadeSetpoint
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from autopilot.records import KIND_IDLE, KIND_TRAJECTORY

WANTS_CLIMB_SPEED = 0.3  # m/s upwards
WANTS_CLIMB_M = 0.3
RAMP_START = 0.15  # thrust limit at which the ramp starts: far below hover for every airframe


def wants_climb(setpoint: CascadeSetpoint, state: EstimatedState) -> bool:
    """Return whether a setpoint asks to leave the ground."""
    if setpoint.kind == KIND_IDLE:
        return False
    if setpoint.kind != KIND_TRAJECTORY:
        return setpoint.thrust > 0.7 * state.hover_thrust
    z, vz, az = setpoint.position_ned[2], setpoint.velocity_ned[2], setpoint.acceleration_ned[2]
    if math.isfinite(z):
        return z < state.position_ned[2] - WANTS_CLIMB_M
    if math.isfinite(vz):
        return vz < -WANTS_CLIMB_SPEED
    return az < -1.0


class TakeoffRamp:
    """Gates every setpoint while the vehicle is on the ground."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._armed_us = 0
        self._ramp_us: int | None = None

    def arm(self, now_us: int) -> None:
        """Start the spool-up."""
        self._armed_us, self._ramp_us = now_us, None

    def gate(self, setpoint: CascadeSetpoint, state: EstimatedState, landed: bool) -> CascadeSetpoint:
        """Return the setpoint that may pass: idle on the ground, thrust-limited in the ramp, unchanged in flight."""
        if setpoint.kind != KIND_TRAJECTORY:
            return setpoint
        now = state.time_us
        if landed and not wants_climb(setpoint, state):
            self._ramp_us = None
            return IDLE
        if now - self._armed_us < self._parameters["COM_SPOOLUP_TIME"] * 1e6 and landed:
            return IDLE
        if self._ramp_us is None:
            if not landed:
                return setpoint
            self._ramp_us = now
        ramp_s = float(self._parameters["MPC_TKO_RAMP_T"])
        elapsed = (now - self._ramp_us) * 1e-6
        if elapsed >= ramp_s:
            if not landed:
                self._ramp_us = None
            return setpoint
        # on the ground a tilt overturns the vehicle, so the way to a distant place begins in the air
        upright = setpoint
        if landed:
            z, vz, az = setpoint.position_ned[2], setpoint.velocity_ned[2], setpoint.acceleration_ned[2]
            upright = setpoint._replace(
                position_ned=(NAN, NAN, z), velocity_ned=(0.0, 0.0, vz), acceleration_ned=(0.0, 0.0, az)
            )
        return upright._replace(thrust_limit=RAMP_START + (1.0 - RAMP_START) * elapsed / ramp_s)
