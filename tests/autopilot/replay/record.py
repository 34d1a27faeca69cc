"""Flies a short flight with every kind of setpoint and records the inputs and outputs of the inner loop.

    python -m tests.autopilot.replay.record

writes flight.npz next to this file. Run it after an intended change of the estimator or the cascade.
"""

from pathlib import Path

import numpy as np

from autopilot.autopilot import Autopilot
from autopilot.control.flight_core import FlightCore, update
from autopilot.records import FREE, NAN, CascadeSetpoint
from autopilot.replay import Recording, ReplayedFlight, load, replay, save
from vehicles import airframe
from vehicles.multirotor import Multirotor
from vehicles.sensors import Suite
from vehicles.wind import Wind

FILE = Path(__file__).with_name("flight.npz")
AIRFRAME = "x500"
ORIGIN = (47.397742, 8.545594, 488.0)
IMU_US = 4_000
SECONDS = 24.0
EVERY = 50  # one row of this many is kept: 5 Hz
TRUTH = ("position_ned", "velocity_ned", "attitude")


def setpoint(seconds: float) -> CascadeSetpoint:
    """Return the offboard setpoint at a time (s) after the takeover: velocity, then position with yaw, then hold."""
    if seconds < 4.0:
        return CascadeSetpoint(
            velocity_ned=(2.0, 0.5, NAN), position_ned=(NAN, NAN, -2.5), acceleration_ned=FREE, yaw=0.0
        )
    if seconds < 8.0:
        return CascadeSetpoint(velocity_ned=FREE, position_ned=(3.0, 4.0, -4.0), acceleration_ned=FREE, yaw=1.5)
    return CascadeSetpoint(velocity_ned=(0.0, 0.0, 0.0), position_ned=FREE, acceleration_ned=FREE, yaw_rate=0.4)


def fly() -> tuple[Recording, dict[str, np.ndarray]]:
    """Return a recording of the flight and the truth at the kept rows."""
    frame = airframe.load(AIRFRAME)
    plant = Multirotor(
        frame, seed=11, origin=ORIGIN, wind=Wind((2.0, -1.0, 0.0), 5.0), suite=Suite(imu_period_us=IMU_US)
    )
    core = FlightCore(frame)
    autopilot = Autopilot(frame, core, plant.sensors, actuators=plant.actuators)
    arguments = core.kernel_args(plant.sensors, plant.actuators)
    commander, offboard = autopilot.commander, autopilot.commander.flight.offboard
    sensors, setpoints, landed = [], [], []
    truth: dict[str, list[np.ndarray]] = {name: [] for name in TRUTH}
    took_over = ready = None
    for row in range(round(SECONDS * 1e6 / IMU_US)):
        plant.advance(IMU_US // 1000)
        sensors.append(plant.sensors.copy())
        setpoints.append(core.setpoint.copy())
        landed.append(bool(core.state["landed"]))
        update(*arguments)
        now = int(plant.sensors["time_us"])
        if row % EVERY == EVERY - 1:
            for name, values in truth.items():
                values.append(plant.truth[name].copy())
        if row % 5:
            continue
        autopilot.update()
        if ready is None and not commander.arming_failures():
            ready = now
            commander.take_off(2.5)
            commander.arm()
        if ready is not None and now - ready > 6_000_000:
            took_over = took_over or now
            offboard.setpoint, offboard.time_us = setpoint((now - took_over) / 1e6), autopilot.state.time_us
            if commander.mode != "OFFBOARD":
                commander.set_mode("OFFBOARD")
    if commander.mode != "OFFBOARD":
        raise RuntimeError(f"the flight ended in {commander.mode}: {commander.arming_failures()}")
    recording = Recording(AIRFRAME, np.array(sensors), np.array(setpoints), np.array(landed))
    return recording, {f"truth.{name}": np.array(values) for name, values in truth.items()}


def main() -> None:
    recording, truth = fly()
    save(recording, FILE)
    kept, _ = load(FILE)  # inertial samples in single precision, as in the replay
    outcome = replay(FlightCore(airframe.load(AIRFRAME)), kept, EVERY)
    golden = {f"golden.{name}": getattr(outcome, name) for name in ReplayedFlight.__slots__}
    save(kept, FILE, **truth, **golden)


if __name__ == "__main__":
    main()
