"""COM_POS_FS_EPH and COM_VEL_FS_EVH in flight: an estimate above the limit becomes invalid, and later valid again."""

import math

import pytest

from autopilot.commander.health import HYSTERESIS_FACTOR, required
from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench
from vehicles import airframe

GPS, OFF = dialect.FAILURE_UNIT_SENSOR_GPS, dialect.FAILURE_TYPE_OFF


@pytest.fixture
def bench() -> Bench:
    bench = Bench(profile="minimal")
    bench.fly()
    return bench


def lost(bench: Bench) -> bool:
    return any("Failsafe: position lost" in text for text in bench.client.texts())


def test_position_in_use_is_lost_beyond_two_and_a_half_times_the_limit(bench: Bench) -> None:
    bench.core.estimate["position_std_h"] = 12.4  # COM_POS_FS_EPH is 5 m
    bench.run(3.0)
    assert not bench.commander.in_failsafe
    bench.core.estimate["position_std_h"] = 12.6
    bench.run(0.3)
    assert lost(bench)
    assert bench.commander.mode == "LAND"
    height = bench.height
    bench.run(2.0)
    assert bench.height < height - 0.5
    assert all(math.isnan(x) for x in bench.core.setpoint["position_ned"][:2])  # without a valid position, none is held


def test_a_lost_position_is_valid_again_after_a_second_within_the_limit(bench: Bench) -> None:
    estimate = bench.core.estimate
    estimate["position_std_h"] = 20.0
    bench.run(0.5)
    assert bench.commander.mode == "LAND"
    estimate["position_std_h"] = 6.0  # good enough to stay valid, not to become valid again
    bench.run(3.0)
    assert bench.commander.mode == "LAND"
    for _ in range(4):  # the second must not be interrupted
        estimate["position_std_h"] = 4.0
        bench.run(0.7)
        estimate["position_std_h"] = 6.0
        bench.run(0.2)
    assert bench.commander.mode == "LAND"
    estimate["position_std_h"] = 4.0
    bench.run(0.8)
    assert bench.commander.mode == "LAND"
    bench.run(0.5)
    assert bench.commander.mode == "HOLD"


def test_velocity_in_use_is_lost_beyond_two_and_a_half_times_the_limit(bench: Bench) -> None:
    bench.core.estimate["velocity_std_h"] = 2.4  # COM_VEL_FS_EVH is 1 m/s
    bench.run(1.0)
    assert bench.autopilot.state.velocity_valid
    bench.core.estimate["velocity_std_h"] = 2.6
    bench.run(0.3)
    assert bench.autopilot.state.velocity_valid  # tolerated, as after a collision; the next fix corrects it
    bench.run(0.4)
    assert not bench.autopilot.state.velocity_valid


def test_position_setpoints_do_not_keep_offboard_active_without_a_position(bench: Bench) -> None:
    def stream() -> None:
        bench.client.send(
            dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDF8, 0, 0, -5, 0, 0, 0, 0, 0, 0, 0, 0)
        )

    bench.autopilot.parameters.set("COM_OBL_RC_ACT", 4)
    stream()
    bench.client.mode(6)
    bench.run(1.0, stream)
    assert bench.commander.mode == "OFFBOARD"
    bench.core.estimate["position_std_h"] = 20.0
    bench.run(1.0, stream)
    assert bench.commander.mode == "LAND"


def test_a_negative_parameter_disables_the_check(bench: Bench) -> None:
    bench.autopilot.parameters.set("COM_POS_FS_EPH", -1.0)
    bench.core.estimate["position_std_h"] = 400.0
    bench.run(2.0)
    assert not bench.commander.in_failsafe
    assert required(bench.autopilot.parameters, "COM_POS_FS_EPH") == math.inf


def test_the_hysteresis_is_reset_after_landing(bench: Bench) -> None:
    bench.core.estimate["position_std_h"] = 20.0
    bench.until(lambda: not bench.commander.armed, 60)
    bench.core.estimate["position_std_h"] = 0.3
    bench.run(0.1)
    assert bench.client.mode(4, 3) == 0
    assert bench.client.arm() == 0
    bench.client.disarm(force=True)
    bench.core.estimate["position_std_h"] = 5.1  # on the ground the limit applies without hysteresis
    bench.run(0.1)
    assert bench.client.arm() == dialect.MAV_RESULT_TEMPORARILY_REJECTED


@pytest.mark.parametrize("demanded", [0.2, 5.0])
def test_without_gnss_the_position_is_lost_at_the_accuracy_limit_or_the_timeout(demanded: float) -> None:
    vehicle = SimulatedVehicle(
        0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=1, origin=(47.4, 8.5, 488.0)
    )

    def live(seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            vehicle.advance()

    commander, parameters = vehicle.autopilot.commander, vehicle.autopilot.parameters
    live(15.0)
    assert commander.arm() == dialect.MAV_RESULT_ACCEPTED
    commander.take_off(-5.0)
    live(10.0)
    assert commander.mode == "HOLD"
    parameters.set("COM_POS_FS_EPH", demanded)
    parameters.set("SYS_FAILURE_EN", 1)
    assert vehicle._failures.inject(GPS, OFF, 0)
    began = vehicle.time_us
    while not commander.in_failsafe:
        live(0.01)
        assert vehicle.time_us - began < 8_000_000
    after_s = (vehicle.time_us - began) * 1e-6
    deviation = float(vehicle.core.estimate["position_std_h"])
    if demanded < 1.0:
        assert deviation == pytest.approx(HYSTERESIS_FACTOR * demanded, rel=0.1)
        assert 1.0 < after_s < 4.5
        assert vehicle.core.estimate["position_valid"]  # the estimator itself still reports it as valid
    else:
        assert after_s == pytest.approx(5.0, abs=0.3)  # EKF2_NOAID_TOUT
        assert deviation < HYSTERESIS_FACTOR * demanded
    assert commander.failsafe.cause == "position lost"
