"""A simulated vehicle that a real PX4 flies: sensors to it, motor outputs from it, in lockstep over its TCP interface.

Every EXCHANGE_US of vehicle time PX4 gets one HIL_SENSOR, which is its clock, and the vehicle waits for the answer to
that very one. A PX4 that has just connected has nothing to answer yet: until its first answer time goes on without it,
the sensors flow, and the rotors stand. The same when one that was in step answers no more.
"""

import time
from typing import Unpack

from dronecats.flight.sitl.vehicle import STEP_US, TICK_US, BootPose, Physics, Vehicle
from foundation.airframe import Airframe
from foundation.mavlink import Packer, dialect
from foundation.truth import TRUTH_COMPONENT
from hil.simulator import SimulatorServer, Told, gps_message, is_armed, rotor_commands, sensor_message, told_now
from vehicles.sensors import Suite

EXCHANGE_US = 4_000  # PX4's SITL start script expects 250 Hz (IMU_INTEG_RATE)
TRUTH_US = 8_000  # what PX4 writes into its own log beside its estimate; it asks for 5 ms
# Wall seconds after which time goes on without an answer. A PX4 that has terminated its flight never gives one again;
# one that hangs is for the agent's link to notice.
ANSWER_S = 3.0
PATIENCE_S = 0.2  # wall seconds between two looks at whether waiting still makes sense
# PX4's start script sets EKF2_GPS_DELAY to 10 ms for this interface. One inertial sample per exchange, over its time.
SUITE = Suite(imu_period_us=EXCHANGE_US, gps_latency_us=10_000)
ACTUATORS = dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS
# µs; until then PX4 gets no sensors. At boot the legs drop onto the ground, and the specific force is up to 3 m/s² off
# for 0.2 s. PX4's EKF2 takes its first tilt from the first samples: a tilt that begins 16° wrong becomes a wrong gyro
# bias, PX4 does not find itself at rest, and its heading may be wrong when it arms.
SETTLED_US = 500_000


class Px4Vehicle(Vehicle):
    """One vehicle and the PX4 that flies it."""

    def __init__(
        self, index: int, airframe: Airframe, pose: BootPose, *, server: SimulatorServer, **physics: Unpack[Physics]
    ) -> None:
        """`server` is where PX4 connects; it is closed with the vehicle."""
        physics.setdefault("suite", SUITE)
        super().__init__(index, airframe, pose, **physics)
        curve = self.plant.airframe.curve
        self._idle = curve.speed_idle / curve.speed_max
        self._rotors = len(self.plant.airframe.rotors)
        self.server = server
        self.released = False  # set by another thread to end a wait for good
        self.in_step = False  # whether PX4 answers each sensor message, and is waited for
        self.answers = 0
        self._told = Told()
        self._to_px4 = Packer(self.index + 1, TRUTH_COMPONENT)

    def advance(self) -> None:
        """Advance by one tick, for as long as PX4 takes to answer."""
        end_us = self.time_us + TICK_US
        while (now_us := self.time_us) < end_us:
            exchange_us = now_us - now_us % EXCHANGE_US + EXCHANGE_US
            self.plant.advance((min(exchange_us, end_us) - now_us) // STEP_US)
            if self.time_us == exchange_us:
                self._exchange()

    def close(self) -> None:
        self.server.close()

    def _exchange(self) -> None:
        if self.time_us <= SETTLED_US:
            return
        if self.server.accept():
            self.in_step = False
        if not self.server.connected:
            self._stop()
            return
        self.server.send(self._sensors())
        if not self.in_step:
            for message in self.server.receive(0.0):
                self._take(message)
            return
        sent_us, sent_s = self.time_us, time.monotonic()
        while self.server.connected and not self.released and int(self.plant.actuators["time_us"]) < sent_us:
            for message in self.server.receive(PATIENCE_S):
                self._take(message)
            if self.server.accept():
                self.in_step = False
                return
            if time.monotonic() - sent_s > ANSWER_S:
                self._stop()
                return

    def _sensors(self) -> bytes:
        """Return what is new for PX4 as bytes. HIL_SENSOR last: it starts PX4's next cycle."""
        sensors, time_us = self.plant.sensors, self.time_us
        data = b""
        if int(sensors["gps_time_us"]) > self._told.gps_us:
            data = self._to_px4.pack(gps_message(sensors))
        if time_us % TRUTH_US == 0:
            data += self.truth()
        data += self._to_px4.pack(sensor_message(sensors, time_us, self._told))
        self._told = told_now(sensors)
        return data

    def _take(self, message: dialect.MAVLink_message) -> None:
        if message.get_msgId() != ACTUATORS:
            return
        actuators = self.plant.actuators
        actuators["armed"] = int(is_armed(message))
        actuators["command"] = rotor_commands(message.controls, self._rotors, self._idle)
        actuators["time_us"] = message.time_usec
        self.in_step = True
        self.answers += 1

    def _stop(self) -> None:
        """Go on without PX4: the motor controllers hear nothing, and stop."""
        self.in_step = False
        self.plant.actuators["armed"] = 0
