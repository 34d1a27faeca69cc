"""MAVLink's failure injection reaches the simulated sensors and rotors. It can be undone."""

import pytest

from dronecats.flight.sitl.failures import SENSORS, Failures
from foundation.mavlink import dialect as d
from vehicles import airframe
from vehicles.faults import Fault
from vehicles.multirotor import Multirotor
from vehicles.sensors import Suite


@pytest.fixture
def plant():
    return Multirotor(airframe.load("x500"), seed=1, origin=(47.4, 8.5, 488.0))


def test_a_gps_receiver_that_is_off_gives_no_fix_until_it_is_restored(plant):
    failures = Failures(plant)
    plant.advance(1000)
    assert failures.inject(d.FAILURE_UNIT_SENSOR_GPS, d.FAILURE_TYPE_OFF, 0)
    plant.advance(500)
    last = int(plant.sensors["gps_time_us"])
    plant.advance(1000)
    assert int(plant.sensors["gps_time_us"]) == last
    assert failures.inject(d.FAILURE_UNIT_SENSOR_GPS, d.FAILURE_TYPE_OK, 0)
    plant.advance(500)
    assert int(plant.sensors["gps_time_us"]) > last


def test_one_rotor_stops_and_can_be_restored(plant):
    failures = Failures(plant)
    assert failures.inject(d.FAILURE_UNIT_SYSTEM_MOTOR, d.FAILURE_TYPE_OFF, 2)
    plant.advance(10)
    assert plant.state["rotor_fault"][:4].tolist() == [1, 0, 1, 1]
    assert failures.inject(d.FAILURE_UNIT_SYSTEM_MOTOR, d.FAILURE_TYPE_OK, 0)
    plant.advance(10)
    assert plant.state["rotor_fault"][:4].tolist() == [1, 1, 1, 1]


@pytest.mark.parametrize(
    ("unit", "kind", "instance"),
    [
        (d.FAILURE_UNIT_SENSOR_AIRSPEED, d.FAILURE_TYPE_OFF, 0),
        (d.FAILURE_UNIT_SENSOR_GPS, d.FAILURE_TYPE_SLOW, 0),
        (d.FAILURE_UNIT_SENSOR_BARO, d.FAILURE_TYPE_DELAYED, 0),
        (d.FAILURE_UNIT_SYSTEM_MOTOR, d.FAILURE_TYPE_STUCK, 1),
        (d.FAILURE_UNIT_SYSTEM_MOTOR, d.FAILURE_TYPE_OFF, 9),
    ],
)
def test_unsupported_failures_are_rejected_without_effect(plant, unit, kind, instance):
    assert not Failures(plant).inject(unit, kind, instance)
    assert int(plant.faults["count"]) == 0


@pytest.mark.parametrize("unit", SENSORS, ids=SENSORS.get)
def test_every_sensor_supports_wrong_values(plant, unit):
    assert Failures(plant).inject(unit, d.FAILURE_TYPE_WRONG, 0)
    assert plant.faults["value"][0].any()


def test_scripted_faults_stay_active_beside_injected_ones_and_can_be_undone():
    script = [Fault("gps", "fail"), Fault("mag", "fail", from_us=500_000)]
    plant = Multirotor(airframe.load("x500"), seed=1, origin=(47.4, 8.5, 488.0), faults=script)
    failures = Failures(plant, script)
    plant.advance(300)
    assert failures.inject(d.FAILURE_UNIT_SYSTEM_MOTOR, d.FAILURE_TYPE_OFF, 1)
    plant.advance(1000)
    assert int(plant.sensors["gps_time_us"]) == 0
    assert int(plant.sensors["mag_time_us"]) < 500_000
    assert failures.inject(d.FAILURE_UNIT_SENSOR_GPS, d.FAILURE_TYPE_OK, 0)
    plant.advance(1000)
    assert int(plant.sensors["gps_time_us"]) > 1_300_000
    assert int(plant.sensors["mag_time_us"]) < 500_000


def test_a_delay_beyond_the_sensor_memory_is_rejected_without_effect(plant):
    plant.set_sensor_suite(Suite().degraded(gps_delay_s=1.4))
    failures = Failures(plant)
    assert not failures.inject(d.FAILURE_UNIT_SENSOR_GPS, d.FAILURE_TYPE_DELAYED, 0)
    assert failures.inject(d.FAILURE_UNIT_SYSTEM_MOTOR, d.FAILURE_TYPE_OFF, 1)
