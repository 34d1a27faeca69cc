"""Messages of PX4's simulator interface, decoded with pymavlink and compared with the protocol."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as pymavlink_dialect

from foundation.mavlink import Packer
from foundation.sensors import MAX_ROTORS, SENSORS
from hil.simulator import (
    ACCEL,
    BARO,
    GYRO,
    MAG,
    SENSOR_BYTES,
    SampleTimes,
    gps_message,
    is_armed,
    rotor_commands,
    sample_times,
    sensor_message,
)
from tests.hil.simulator.stand_in import recorded

numbers = st.floats(-300.0, 300.0, width=32)
vectors = st.tuples(numbers, numbers, numbers)
times = st.integers(0, 2**40)


def read(message):
    """Encode a message and return it as decoded by pymavlink."""
    reader = pymavlink_dialect.MAVLink(None)
    (decoded,) = reader.parse_buffer(Packer(1, 51).pack(message))
    return decoded


def record(**fields):
    sensors = np.zeros(1, SENSORS)[0]
    for name, value in fields.items():
        sensors[name] = value
    return sensors


@given(vectors, vectors, vectors, st.floats(200.0, 1100.0, width=32), numbers, times)
def test_sensor_values_are_sent_in_their_fields(accel, gyro, mag, pressure, temperature, time_us):
    message = read(
        sensor_message(
            record(accel_frd=accel, gyro_frd=gyro, mag_frd=mag, pressure_hpa=pressure, temperature_c=temperature),
            time_us,
            SampleTimes(),
        )
    )
    assert (message.xacc, message.yacc, message.zacc) == accel
    assert (message.xgyro, message.ygyro, message.zgyro) == gyro
    assert (message.xmag, message.ymag, message.zmag) == mag
    assert (message.abs_pressure, message.temperature, message.diff_pressure) == (pressure, temperature, 0.0)
    assert (message.time_usec, message.id) == (time_us, 0)


@given(st.booleans(), st.booleans(), st.booleans())
def test_updated_flags_are_set_for_complete_sensor_groups(imu, mag, baro):
    sensors = record(imu_time_us=4000 * imu, mag_time_us=4000 * mag, baro_time_us=4000 * baro)
    updated = read(sensor_message(sensors, 4000, SampleTimes())).fields_updated
    assert updated == (ACCEL | GYRO) * imu + MAG * mag + BARO * baro
    for group, bits in ((ACCEL, (0, 1, 2)), (GYRO, (3, 4, 5)), (MAG, (6, 7, 8)), (BARO, (9, 11, 12))):
        assert group == sum(1 << bit for bit in bits)  # the bits that PX4's SimulatorMavlink tests
    assert read(sensor_message(sensors, 8000, sample_times(sensors))).fields_updated == 0  # nothing is sent twice


@given(st.floats(-90, 90), st.floats(-180, 180), st.floats(-400, 9000), vectors, st.floats(0, 2000), st.floats(0, 2000))
def test_a_gps_fix_is_sent_in_the_units_of_the_message(lat, lon, alt, velocity, eph, epv):
    fix = read(
        gps_message(
            record(
                gps_time_us=123_000,
                gps_lat_deg=lat,
                gps_lon_deg=lon,
                gps_alt_m=alt,
                gps_velocity_ned=velocity,
                gps_eph_m=eph,
                gps_epv_m=epv,
                gps_fix_type=3,
                gps_satellites=14,
            )
        )
    )
    assert fix.lat / 1e7 == pytest.approx(lat, abs=1e-7)
    assert fix.lon / 1e7 == pytest.approx(lon, abs=1e-7)
    assert fix.alt / 1e3 == pytest.approx(alt, abs=1e-3)
    assert [v / 100 for v in (fix.vn, fix.ve, fix.vd)] == pytest.approx(list(velocity), abs=0.006)
    assert fix.vel / 100 == pytest.approx(math.hypot(*velocity[:2]), abs=0.006)
    assert fix.eph / 100 == pytest.approx(min(eph, 655.34), abs=0.006)
    assert fix.epv / 100 == pytest.approx(min(epv, 655.34), abs=0.006)
    assert (fix.time_usec, fix.fix_type, fix.satellites_visible, fix.id) == (123_000, 3, 14, 0)
    if fix.cog == 65535:
        assert math.hypot(*velocity[:2]) < 0.3
    else:
        east, north = math.sin(math.radians(fix.cog / 100)), math.cos(math.radians(fix.cog / 100))
        assert north * velocity[1] - east * velocity[0] == pytest.approx(0.0, abs=0.1)
        assert north * velocity[0] + east * velocity[1] > 0.0


def test_sensor_bytes_is_the_size_of_the_largest_sensor_message():
    full = record(
        accel_frd=1.1, gyro_frd=1.1, mag_frd=1.1, pressure_hpa=1000.1, temperature_c=20.1,
        imu_time_us=1, mag_time_us=1, baro_time_us=1,
    )  # fmt: skip
    assert len(Packer(1, 51).pack(sensor_message(full, 2**62, SampleTimes()))) == SENSOR_BYTES


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=16, max_size=16), st.floats(0, 0.9))
def test_any_px4_output_becomes_rotor_commands_between_idle_and_full_speed(outputs, idle):
    commands = rotor_commands(outputs, 4, idle)
    assert len(commands) == MAX_ROTORS
    assert all(idle <= command <= 1.0 for command in commands[:4])
    assert commands[4:] == [0.0] * 4


def test_rotor_commands_scale_linearly_between_idle_and_full_speed():
    assert rotor_commands([0.0, 0.5, 1.0, 2.0], 4, 0.2)[:4] == pytest.approx([0.2, 0.6, 1.0, 1.0])


def test_a_booting_real_px4_sends_disarmed_lockstep_outputs():
    messages = recorded("px4-boot.bin")
    assert [m.get_type() for m in messages[:2]].count("HEARTBEAT") == 1
    answers = [m for m in messages if m.get_type() == "HIL_ACTUATOR_CONTROLS"]
    assert len(answers) > 50
    assert {(is_armed(m), m.flags) for m in answers} == {(False, 1)}  # flags: built with lockstep
    assert np.diff([m.time_usec for m in answers]).tolist() == [4000] * (len(answers) - 1)


def test_a_real_px4_spins_the_rotors_together_at_take_off():
    answers = recorded("px4-takeoff.bin")
    armed = [is_armed(m) for m in answers]
    assert armed == sorted(armed)  # it arms once
    assert 0 < armed.count(False) < armed.count(True)
    commands = np.array([rotor_commands(m.controls, 4, 0.15)[:4] for m in answers if is_armed(m)])
    assert np.ptp(commands, axis=1).max() < 0.2  # all four rotors have similar commands
    assert commands[:, 0].min() < 0.3 < 0.6 < commands[:, 0].max()  # from idle to above hover
    assert all(m.controls[4:] == [0.0] * 12 for m in answers)
