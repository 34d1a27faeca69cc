"""A client orders the flight controller to restart: it restarts in place, with its parameters, on the same ports."""

import math

import numpy as np
import pytest

from autopilot.commander.plans import FENCE, MISSION, RALLY, PlanItem
from autopilot.control.gains import read
from autopilot.mavlink.node import BY_NAME
from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle, Simulation
from dronecats.flight.stages.lockstep import Lockstep
from foundation.mavlink import MODES, dialect
from hil.link.link import Link
from vehicles import airframe


@pytest.mark.parametrize("kept_in_a_file", [False, True])
def test_a_restart_keeps_parameters_ports_and_place(tmp_path, kept_in_a_file):
    vehicle = SimulatedVehicle(
        0, airframe.load("x500"), BootPose((2.0, -3.0, 0.0), 1.0), seed=4, origin=(47.4, 8.5, 488.0),
        state_dir=tmp_path if kept_in_a_file else None,
    )  # fmt: skip
    transport = Lockstep(Simulation([vehicle])).transport(0)
    link = Link(transport)
    link.connect()
    link.wait(12.0)
    vehicle.autopilot.parameters.set("MPC_XY_VEL_MAX", 7.5)
    before, stood, now = vehicle.autopilot, vehicle.plant.truth["position_ned"].copy(), link.time_us
    link.send(
        dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 0, 1, 0, 0, 0, 0, 0, 0)
    )
    link, answers = Link(transport), []  # the requested streams are forgotten, so the client connects anew
    link.listeners.append(lambda m: answers.append((m.command, m.result)) if m.get_type() == "COMMAND_ACK" else None)
    link.connect()
    assert answers[0] == (dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, dialect.MAV_RESULT_ACCEPTED)
    assert vehicle.autopilot is not before
    assert not vehicle.autopilot.reboot_requested
    assert vehicle.autopilot.parameters["MPC_XY_VEL_MAX"] == 7.5
    assert read(vehicle.core.params, "MPC_XY_VEL_MAX") == 7.5
    assert vehicle.plant.truth["position_ned"] == pytest.approx(stood, abs=1e-6)
    link.wait(12.0)
    assert link.time_us > now + 10_000_000
    link.order("take-off", dialect.MAV_CMD_NAV_TAKEOFF, *(math.nan,) * 7)
    link.arm()
    link.wait(6.0)
    assert vehicle.plant.truth["position_ned"][2] < -1.0


@pytest.mark.parametrize("kept_in_a_file", [False, True])
def test_a_restart_keeps_the_plans_and_resets_the_message_intervals(tmp_path, kept_in_a_file):
    folder = tmp_path if kept_in_a_file else None
    place, origin = BootPose((0.0, 0.0, 0.0), 0.0), (47.4, 8.5, 488.0)
    vehicle = SimulatedVehicle(0, airframe.load("x500"), place, seed=4, origin=origin, state_dir=folder)
    link = Link(Lockstep(Simulation([vehicle])).transport(0, "onboard"))
    link.connect()
    link.wait(1.0)
    plans = {
        MISSION: (PlanItem(22, 6, (0.0, 0.0, 0.0, math.nan), 474000000, 85000000, 10.0),) * 3,
        FENCE: (PlanItem(5003, 5, (80.0, 0.0, 0.0, 0.0), 474000000, 85000000, 0.0),),
        RALLY: (PlanItem(5100, 6, (0.0, 0.0, 0.0, 0.0), 474001000, 85000000, 0.0),),
    }
    for kind, items in plans.items():
        vehicle.autopilot.commander.replace_plan(kind, items)
    link.send(dialect.MAVLink_mission_set_current_message(1, 1, 2))
    attitude, imu = BY_NAME["ATTITUDE"].message_id, BY_NAME["HIGHRES_IMU"].message_id
    for message, interval in ((attitude, -1), (imu, 5_000)):
        assert link.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message, interval) == dialect.MAV_RESULT_ACCEPTED
    port = vehicle.autopilot.node.ports[0]
    assert (port.interval_us(attitude), port.interval_us(imu)) == (-1, 5_000)
    link.send(
        dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 0, 1, 0, 0, 0, 0, 0, 0)
    )
    before = vehicle.autopilot
    link.wait(1.0)
    assert vehicle.autopilot is not before
    flight = vehicle.autopilot.commander.flight
    assert {kind: repr(items) for kind, items in flight.plans.items.items()} == {
        kind: repr(items) for kind, items in plans.items()
    }
    assert vehicle.autopilot.commander.mission.current == 2
    # intervals are not stored: PX4 boots with the rates of its start script
    port = vehicle.autopilot.node.ports[0]
    assert (port.interval_us(attitude), port.interval_us(imu)) == (10_000, 20_000)
    if kept_in_a_file:
        vehicle.close()
        again = SimulatedVehicle(0, airframe.load("x500"), place, seed=4, origin=origin, state_dir=folder)
        assert repr(again.autopilot.commander.flight.plans.items) == repr(flight.plans.items)


def test_a_restart_repairs_a_fallen_vehicle_and_returns_it_to_its_place():
    vehicle = SimulatedVehicle(
        0, airframe.load("x500"), BootPose((3.0, -2.0, 0.0), 1.0), seed=4, origin=(47.4, 8.5, 488.0)
    )
    transport = Lockstep(Simulation([vehicle])).transport(0)
    link = Link(transport)
    link.connect()
    link.wait(12.0)
    stood, state = vehicle.plant.truth["position_ned"].copy(), vehicle.plant.state
    state["position"], state["attitude"] = (9.0, 9.0, -0.3), (0.0, 1.0, 0.0, 0.0)
    state["charge_ah"] *= 0.01
    state["rotor_health"][1] = 0.0
    link.wait(4.0)
    assert vehicle.autopilot.commander.arming_failures()
    now = vehicle.time_us
    link.send(
        dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 0, 1, 0, 0, 0, 0, 0, 0)
    )
    link = Link(transport)
    link.connect()
    assert vehicle.time_us > now
    assert vehicle.plant.truth["position_ned"] == pytest.approx(stood, abs=1e-3)
    assert vehicle.plant.state["upside_down"] == 0
    assert (vehicle.plant.state["rotor_health"][:4] == 1.0).all()
    link.wait(15.0)
    assert vehicle.autopilot.commander.arming_failures() == []
    assert vehicle.plant.sensors["battery_remaining"] > 0.98


def test_a_battery_is_not_drained_below_its_kept_charge():
    vehicle = SimulatedVehicle(
        0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=4, origin=(47.4, 8.5, 488.0)
    )
    vehicle.plant.keep_charge(0.5)
    capacity = float(vehicle.plant.params["capacity_ah"])
    for share, stays in ((0.52, False), (0.5, True)):
        vehicle.plant.state["charge_ah"] = share * capacity
        for _ in range(100):
            vehicle.advance()
        assert (vehicle.plant.state["charge_ah"] == share * capacity) is np.bool_(stays)


def test_a_vehicle_in_flight_does_not_restart():
    vehicle = SimulatedVehicle(
        0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=4, origin=(47.4, 8.5, 488.0)
    )
    link = Link(Lockstep(Simulation([vehicle])).transport(0))
    link.connect()
    link.wait(12.0)
    link.order("take-off", dialect.MAV_CMD_DO_SET_MODE, 1, MODES["TAKEOFF"].main, MODES["TAKEOFF"].sub)
    link.arm()
    link.wait(3.0)
    before = vehicle.autopilot
    assert link.command(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == dialect.MAV_RESULT_DENIED
    assert vehicle.autopilot is before
