"""A simulated vehicle that an autopilot board flies over a wire, in real time."""

import time
from typing import Unpack

from dronecats.flight.sitl.pace import RateKeeper
from dronecats.flight.sitl.vehicle import STEP_US, TICK_US, BootPose, Physics, Vehicle
from foundation.airframe import Airframe
from hil.simulator.board import BoardLine
from hil.simulator.interface import Told, gps_message, is_armed, rotor_commands, sensor_message, told_now
from vehicles.sensors import Suite

SILENCE_S = 0.5  # wall seconds after which a motor controller that hears nothing stops


class BoardVehicle(Vehicle):
    """One vehicle and the board that flies it."""

    def __init__(
        self,
        index: int,
        airframe: Airframe,
        pose: BootPose,
        *,
        line: BoardLine,
        period_us: int,
        **physics: Unpack[Physics],
    ) -> None:
        """`period_us`: between two sensor messages, whatever the suite of `physics`."""
        physics["suite"] = Suite(imu_period_us=period_us)
        super().__init__(index, airframe, pose, **physics)
        curve = self.plant.airframe.curve
        self._idle = curve.speed_idle / curve.speed_max
        self._rotors = len(self.plant.airframe.rotors)
        self._period_us = period_us
        self._told = Told()
        self.line = line
        self.keeper = RateKeeper(period_us / 1e6)

    @property
    def flown(self) -> bool:
        """Whether the board takes the sensors and drives the rotors."""
        return self.line.in_hil and time.monotonic() - self.line.actuators_s < SILENCE_S

    def advance(self) -> None:
        """Advance by one tick of real time."""
        end_us = self.time_us + TICK_US
        while (now_us := self.time_us) < end_us:
            exchange_us = now_us - now_us % self._period_us + self._period_us
            self.plant.advance((min(exchange_us, end_us) - now_us) // STEP_US)
            if self.time_us == exchange_us:
                self.keeper.wait()
                self._exchange()

    def close(self) -> None:
        self.line.close()

    def _exchange(self) -> None:
        self.line.exchange()
        if self.line.in_hil:
            sensors = self.plant.sensors
            if int(sensors["gps_time_us"]) > self._told.gps_us:
                self.line.send(gps_message(sensors))
            self.line.send(sensor_message(sensors, self.time_us, self._told))
            self._told = told_now(sensors)
        actuators, said = self.plant.actuators, self.line.actuators
        actuators["armed"] = 0
        if said is not None and self.flown:
            actuators["armed"] = int(is_armed(said))
            actuators["command"] = rotor_commands(said.controls, self._rotors, self._idle)
            actuators["time_us"] = self.time_us
