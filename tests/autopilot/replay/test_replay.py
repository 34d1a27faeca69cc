"""Replays the golden flight through estimator and cascade, and compares each output within its tolerance.

After an intended change of the outputs, run `python -m tests.autopilot.replay.record`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autopilot.control.flight_core import FlightCore
from autopilot.replay import ReplayedFlight, load, replay, save
from foundation.errors import UsageError
from tests.autopilot.replay.record import AIRFRAME, EVERY, FILE, fly
from vehicles import airframe

TOLERANCES = {  # other compilers round differently; a changed gain or noise figure exceeds these by far
    "position_ned": 2e-3,  # m
    "velocity_ned": 2e-3,  # m/s
    "attitude": 2e-4,
    "gyro_bias": 1e-5,  # rad/s
    "accel_bias": 1e-4,  # m/s²
    "rates_setpoint": 5e-3,  # rad/s
    "thrust_setpoint": 1e-3,
    "command": 3e-3,
}


@pytest.fixture(scope="module")
def golden():
    return load(FILE)


@pytest.fixture(scope="module")
def replayed(golden):
    return replay(FlightCore(airframe.load(AIRFRAME)), golden[0], EVERY)


@pytest.mark.parametrize("name", TOLERANCES)
def test_outputs_match_the_golden_flight(name, golden, replayed):
    assert getattr(replayed, name) == pytest.approx(golden[1][f"golden.{name}"], abs=TOLERANCES[name])


def test_every_output_has_a_tolerance_and_the_golden_flight_moves(golden, replayed):
    assert set(TOLERANCES) | {"time_us"} == set(ReplayedFlight.__slots__)
    assert (replayed.time_us == golden[1]["golden.time_us"]).all()
    assert np.ptp(replayed.position_ned, axis=0).min() > 1.0
    assert replayed.command.max() > 0.5


def test_the_estimate_of_the_golden_flight_follows_the_truth(golden, replayed):
    """The first 50 rows (10 s) are left out, because the estimate does not exist from the start."""
    aloft = slice(50, None)
    assert replayed.velocity_ned[aloft] == pytest.approx(golden[1]["truth.velocity_ned"][aloft], abs=0.4)
    turned = np.abs(np.sum(replayed.attitude[aloft] * golden[1]["truth.attitude"][aloft], axis=1))
    assert np.degrees(2.0 * np.arccos(np.minimum(turned, 1.0))).max() < 4.0


def test_a_changed_gain_exceeds_the_tolerance(golden, replayed):
    core = FlightCore(airframe.load(AIRFRAME))
    core.set_parameter("MPC_XY_VEL_P_ACC", 2.1)
    other = replay(core, golden[0], EVERY)
    assert np.abs(other.command - replayed.command).max() > TOLERANCES["command"]


def test_a_changed_noise_figure_exceeds_the_tolerance(golden, replayed):
    core = FlightCore(airframe.load(AIRFRAME))
    core.filter_params["gps_velocity_noise"] *= 1.1
    other = replay(core, golden[0], EVERY)
    assert np.abs(other.velocity_ned - replayed.velocity_ned).max() > TOLERANCES["velocity_ned"]


def test_a_saved_recording_is_loaded_without_loss(golden, tmp_path: Path):
    recording = golden[0]
    short = replace(
        recording, sensors=recording.sensors[:700], setpoints=recording.setpoints[:700], landed=recording.landed[:700]
    )
    save(short, tmp_path / "short.npz")
    again, _ = load(tmp_path / "short.npz")
    assert again.sensors.tobytes() == short.sensors.tobytes()
    assert again.setpoints.tobytes() == short.setpoints.tobytes()
    assert (again.landed == short.landed).all()


def test_invalid_recordings_are_rejected(tmp_path: Path):
    (tmp_path / "no.npz").write_bytes(b"nothing")
    with pytest.raises(UsageError, match=r"record\.py"):
        load(tmp_path / "no.npz")


def test_the_golden_file_is_smaller_than_300_kb():
    assert FILE.stat().st_size < 300_000


def test_the_flight_can_be_recorded_again():
    recording, truth = fly()
    assert len(recording.sensors) == len(truth["truth.position_ned"]) * EVERY
    assert recording.setpoints["armed"].any()
