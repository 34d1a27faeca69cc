"""The simulated vehicle and PX4 wait for each other. PX4 may connect and disconnect at any time."""

import threading

import numpy as np
import pytest

from dronecats.flight.sitl import px4 as px4_vehicle
from dronecats.flight.sitl.px4 import EXCHANGE_US, SETTLED_US, Px4Vehicle
from dronecats.flight.sitl.simulation import TICK_US, BootPose
from foundation.terrain import HeightField
from hil.simulator import ACCEL, BARO, GYRO, MAG, SimulatorServer
from tests.hil.simulator.stand_in import Replay, StandIn, always, controls, recorded, silent
from vehicles import airframe

ORIGIN = (47.3977, 8.5456, 488.0)


def settled(seed=0):
    """Return a vehicle that stands at rest; the next exchange is the first one."""
    pose, server = BootPose((0.0, 0.0, 0.0), 0.0), SimulatorServer(0)
    vehicle = Px4Vehicle(0, airframe.load("x500"), pose, seed=seed, origin=ORIGIN, server=server)
    fly(vehicle, SETTLED_US / 1e6)
    return vehicle


@pytest.fixture
def vehicle():
    vehicle = settled()
    yield vehicle
    vehicle.close()


@pytest.fixture
def connect(vehicle):
    clients = []

    def start(answer, port=vehicle.server.port):
        clients.append(StandIn(port, answer))
        return clients[-1]

    yield start
    for client in clients:
        client.close()


def fly(vehicle, seconds):
    end_us = vehicle.time_us + round(seconds * 1e6)
    while vehicle.time_us < end_us:
        vehicle.advance()


def come_into_step(vehicle, client):
    """Advance until the vehicle waits for PX4. Until then, only this loop keeps both at the same pace."""
    while not vehicle.in_step:
        vehicle.advance()
        client.keep_up(vehicle.time_us // EXCHANGE_US * EXCHANGE_US)


def test_every_sensor_message_is_answered_before_time_advances(vehicle, connect):
    ahead = []

    def answer(sensor):
        ahead.append(vehicle.time_us - sensor.time_usec)  # read while the vehicle waits
        return controls(sensor.time_usec)

    client = connect(answer)
    come_into_step(vehicle, client)
    fly(vehicle, 1.0)
    times = [m.time_usec for m in client.named("HIL_SENSOR")]
    assert vehicle.in_step
    assert set(np.diff(times)) == {EXCHANGE_US}
    assert set(ahead[-240:]) == {0}


def test_time_advances_and_sensors_are_sent_before_the_first_answer(vehicle, connect):
    client = connect(lambda sensor: controls(sensor.time_usec) if sensor.time_usec >= SETTLED_US + 200_000 else b"")
    fly(vehicle, 0.15)
    assert not vehicle.in_step
    assert vehicle.time_us == SETTLED_US + 150_000
    come_into_step(vehicle, client)
    times = [m.time_usec for m in client.named("HIL_SENSOR")]
    assert times[:3] == [SETTLED_US + 4000, SETTLED_US + 8000, SETTLED_US + 12000]


def test_an_answer_to_an_earlier_message_does_not_count_for_the_current_one(vehicle, connect):
    release, slow_us = threading.Event(), [10**9]

    def answer(sensor):
        time_us = sensor.time_usec
        if time_us == slow_us[0]:
            release.wait(10.0)
            return controls(time_us, (0.7,) * 4, armed=True)
        if time_us == slow_us[0] - EXCHANGE_US:
            twice = controls(time_us) + controls(time_us)  # PX4 may publish twice in a cycle
            return controls(time_us - EXCHANGE_US) + twice
        return controls(time_us)

    client = connect(answer)
    come_into_step(vehicle, client)
    slow_us[0] = (vehicle.time_us // EXCHANGE_US + 10) * EXCHANGE_US
    worker = threading.Thread(target=fly, args=(vehicle, 0.2))
    worker.start()
    worker.join(1.0)
    assert worker.is_alive()
    assert vehicle.time_us == slow_us[0]
    release.set()
    worker.join(10.0)
    assert not worker.is_alive()


def test_each_sensor_group_is_sent_at_its_own_rate(vehicle, connect):
    client = connect(always(armed=False))
    come_into_step(vehicle, client)
    fly(vehicle, 2.0)
    updated = [m.fields_updated for m in client.named("HIL_SENSOR")[-250:]]
    assert sum(u & (ACCEL | GYRO) == ACCEL | GYRO for u in updated) == 250
    assert sum(u & MAG == MAG for u in updated) == pytest.approx(100, abs=1)
    assert sum(u & BARO == BARO for u in updated) == pytest.approx(50, abs=1)
    fixes = [m for m in client.named("HIL_GPS") if m.time_usec > SETTLED_US]
    assert len(fixes) == pytest.approx(20, abs=1)
    assert len(client.named("HIL_STATE_QUATERNION")) == pytest.approx(250, abs=25)


def test_the_first_samples_are_those_of_a_vehicle_at_rest(connect):
    """PX4 connects at boot, while the vehicle still settles onto a slope of 1:50."""
    pose, server = BootPose((0.0, 0.0, 0.0), 0.0), SimulatorServer(0)
    slope = HeightField(-5.0, -5.0, 5.0, np.repeat([[-0.1], [0.0], [0.1]], 3, axis=1))
    vehicle = Px4Vehicle(0, airframe.load("x500"), pose, seed=0, origin=ORIGIN, terrain=slope, server=server)
    client = connect(always(armed=False), server.port)
    try:
        fly(vehicle, SETTLED_US / 1e6 + 0.2)
        client.keep_up(SETTLED_US + 200_000)
        sensors = client.named("HIL_SENSOR")
        assert len(sensors) > 10
        for sensor in sensors:
            assert (sensor.xacc, sensor.yacc, sensor.zacc) == pytest.approx((-0.2, 0.0, -9.8), abs=0.3)
    finally:
        vehicle.close()


def test_a_vehicle_on_the_ground_measures_gravity_pressure_and_position(vehicle, connect):
    client = connect(always(armed=False))
    come_into_step(vehicle, client)
    fly(vehicle, 1.0)
    sensor, fix = client.named("HIL_SENSOR")[-1], client.named("HIL_GPS")[-1]
    assert sensor.zacc == pytest.approx(-9.81, abs=0.2)
    assert sensor.abs_pressure == pytest.approx(956.0, abs=1.0)  # ISA at 488 m
    assert (fix.lat / 1e7, fix.lon / 1e7) == pytest.approx(ORIGIN[:2], abs=2e-5)
    assert fix.alt / 1e3 == pytest.approx(488.0, abs=3.0)
    assert 0 <= client.named("HIL_SENSOR")[-1].time_usec - fix.time_usec <= 120_000


def test_motor_outputs_lift_the_vehicle_and_rotors_are_in_px4s_order(vehicle, connect):
    client = connect(always(0.8, 0.8, 0.8, 0.8))
    come_into_step(vehicle, client)
    fly(vehicle, 1.0)
    assert vehicle.plant.truth["position_ned"][2] < -1.0
    # PX4's order: 0 front right, 1 rear left, both counter-clockwise; 2 front left, 3 rear right
    rotors = [(np.sign(r.position_frd[0]), np.sign(r.position_frd[1]), r.spin) for r in vehicle.plant.airframe.rotors]
    assert rotors == [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)]


def test_px4_may_exit_in_the_air_and_reconnect(vehicle, connect):
    first = connect(always(0.85, 0.85, 0.85, 0.85))
    come_into_step(vehicle, first)
    fly(vehicle, 1.0)
    died_us = vehicle.time_us
    first.close()
    fly(vehicle, 0.2)
    assert not vehicle.in_step
    assert vehicle.plant.actuators["armed"] == 0  # no motor outputs arrive any more
    second = connect(lambda sensor: controls(sensor.time_usec) if sensor.time_usec > died_us + 400_000 else b"")
    come_into_step(vehicle, second)
    fly(vehicle, 0.5)
    times = [m.time_usec for m in second.named("HIL_SENSOR")]
    assert vehicle.in_step
    assert times[0] > died_us
    assert times == sorted(times)
    assert vehicle.server.connections == 2


def test_without_px4_time_advances_tick_by_tick(vehicle):
    vehicle.advance()
    vehicle.advance()
    assert vehicle.time_us == SETTLED_US + 2 * TICK_US
    assert not vehicle.server.connected


def test_releasing_the_vehicle_ends_its_wait_for_an_answer(vehicle, connect):
    quiet = threading.Event()
    client = connect(lambda sensor: b"" if quiet.is_set() else controls(sensor.time_usec))
    come_into_step(vehicle, client)
    quiet.set()
    worker = threading.Thread(target=fly, args=(vehicle, 0.1))
    worker.start()
    worker.join(0.5)
    assert worker.is_alive()
    vehicle.released = True
    worker.join(10.0)
    assert not worker.is_alive()


def test_time_advances_and_rotors_stop_after_a_flight_termination(vehicle, connect, monkeypatch):
    """A real PX4 then publishes no more outputs, and waits for time to pass like other clients."""
    monkeypatch.setattr(px4_vehicle, "ANSWER_S", 0.3)
    quiet = [10**9, 10**9]  # µs, begin and end of PX4's silence

    def answer(sensor):
        silenced = quiet[0] <= sensor.time_usec < quiet[1]
        return b"" if silenced else controls(sensor.time_usec, (0.85,) * 4, armed=True)

    client = connect(answer)
    come_into_step(vehicle, client)
    fly(vehicle, 1.0)
    quiet[:] = vehicle.time_us, vehicle.time_us + 400_000
    fly(vehicle, 0.2)
    assert not vehicle.in_step
    assert vehicle.server.connected
    assert vehicle.plant.actuators["armed"] == 0
    come_into_step(vehicle, client)  # PX4 answers again, so the vehicle waits for it as before
    assert vehicle.plant.actuators["armed"] == 1


def test_a_recorded_px4_boot_reaches_lockstep(vehicle, connect):
    replay = Replay("px4-boot.bin", later_us=SETTLED_US)  # its first sensor message was sent at 0
    come_into_step(vehicle, connect(replay))
    assert vehicle.time_us < max(replay.frames)
    while vehicle.time_us < max(replay.frames) - TICK_US:
        vehicle.advance()
    assert vehicle.in_step
    assert vehicle.plant.actuators["armed"] == 0
    assert vehicle.plant.actuators["time_us"] % EXCHANGE_US == 0


def test_the_same_answers_give_the_same_flight(connect):
    """In lockstep, the vehicle's state depends only on PX4's answers."""
    outputs = [m.controls[:4] for m in recorded("px4-takeoff.bin")]

    def fly_once():
        vehicle = settled(seed=7)
        client = StandIn(
            vehicle.server.port,
            lambda sensor: controls(
                sensor.time_usec, outputs[min((sensor.time_usec - SETTLED_US) // 4000, len(outputs) - 1)], True
            ),
        )
        try:
            while not vehicle.server.accept():
                pass
            vehicle.in_step = True  # from the first message on, so the result does not depend on thread timing
            fly(vehicle, 2.0)
            return vehicle.plant.truth.tobytes(), [bytes(m.get_msgbuf()) for m in client.got]
        finally:
            client.close()
            vehicle.close()

    first, second = fly_once(), fly_once()
    assert first == second


def test_silence_is_not_an_answer(vehicle, connect):
    connect(silent)
    fly(vehicle, 0.3)
    assert vehicle.time_us == SETTLED_US + 300_000
    assert not vehicle.in_step
