"""Estimator resets appear in truth.jsonl, in the metrics and in the verdict, with the quantity that was reset."""

import math

import pytest

from dronecats.flight.logger.estimator_resets import ResetWatch
from dronecats.flight.logger.logger_process import subscribe
from dronecats.flight.logger.recorder import EstimateRecorder, Recorder
from dronecats.judge.judged_flight import JudgedFlight, outcome
from dronecats.judge.metrics.judging import METRICS
from foundation.camera import CameraModel
from foundation.frames import quat_from_euler, rotate_inverse
from foundation.mavlink import Packer, dialect
from foundation.run_folder.reading import read
from tests.flight.sitl.before_a_wall import flying, stream
from tests.flight.sitl.test_contacts_in_the_record import NOTHING, ORIGIN

PACKER = Packer(1, 1)
LEVEL = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "yaw_deg", "yaw_rate_deg"), 0.0)


def odometry(t_s, counter, in_body_frame=False, **estimate):
    e = LEVEL | estimate
    q = quat_from_euler(0.0, 0.0, math.radians(e["yaw_deg"]))
    velocity = (e["vx"], e["vy"], e["vz"])
    frame = dialect.MAV_FRAME_BODY_FRD if in_body_frame else dialect.MAV_FRAME_LOCAL_NED
    return PACKER.pack(
        dialect.MAVLink_odometry_message(
            round(t_s * 1e6), dialect.MAV_FRAME_LOCAL_NED, frame, e["x"], e["y"], e["z"], list(q),
            *(rotate_inverse(q, velocity) if in_body_frame else velocity),
            0.0, 0.0, math.radians(e["yaw_rate_deg"]), [0.0] * 21, [0.0] * 21, counter,
            dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT, 100,
        )
    )  # fmt: skip


@pytest.mark.parametrize(
    ("after", "quantities"),
    [
        ({"yaw_deg": -87.0}, ("yaw",)),
        ({"x": 3.0, "y": -4.0}, ("position",)),
        ({"z": 2.0}, ("height",)),
        ({"vx": 2.5}, ("velocity",)),
        ({"x": 3.0, "vy": 2.5}, ("position", "velocity")),
        ({"x": 0.05}, ()),
    ],
)
@pytest.mark.parametrize("in_body_frame", [False, True])
def test_a_reset_names_the_quantities_that_jumped(after, quantities, in_body_frame):
    watch = ResetWatch()
    assert watch.frame(odometry(1.0, 7, in_body_frame)) is None
    reset = watch.frame(odometry(1.2, 8, in_body_frame, **after))
    assert reset is not None
    assert (reset.count, reset.quantities) == (1, quantities)
    assert reset.yaw_deg == pytest.approx(after.get("yaw_deg", 0.0), abs=1e-3)


def test_motion_between_two_samples_is_not_a_jump():
    moving = {"vx": 5.0, "vz": -1.0, "yaw_rate_deg": 60.0}
    watch = ResetWatch()
    watch.frame(odometry(1.0, 0, **moving))
    reset = watch.frame(odometry(1.2, 1, x=1.0, z=-0.2, yaw_deg=12.0, **moving))
    assert reset is not None
    assert reset.quantities == ()


def test_the_counter_wraps_and_late_messages_are_ignored():
    watch = ResetWatch()
    resets = [watch.frame(odometry(t, n)) for t, n in ((1.0, 254), (1.2, 255), (1.1, 254), (1.2, 255), (1.4, 1))]
    assert [reset and reset.count for reset in resets] == [None, 1, None, None, 2]


def test_a_reset_of_our_estimator_is_recorded(tmp_path):
    vehicle = flying(1)
    port = vehicle.open_port("minimal")
    subscribe(port.receive, 1)
    (tmp_path / "decisions.jsonl").write_text("")
    recorder = Recorder(tmp_path, ORIGIN, lambda *_: NOTHING, CameraModel())

    def fly(seconds):
        for tick in range(round(100 * seconds)):
            if tick % 5 == 0:
                stream(vehicle, 0.0)
            vehicle.advance()
            recorder.truth(vehicle.truth())
            recorder.telemetry(port.take())

    fly(1.0)
    resets_before = int(vehicle.core.filter_state["resets"])
    recorder.begin(vehicle.time_us, 300.0)
    vehicle.core.filter_state["position"][1] += 60.0  # fixes are now 60 m off, so the filter rejects them for 7 s
    fly(9.0)
    recorder.end("cap")
    recorder.close()
    logs = read(tmp_path)
    assert sum(reset.count for reset in logs.resets) == int(vehicle.core.filter_state["resets"]) - resets_before == 1
    (reset,) = logs.resets
    assert reset.quantities == ("position",)
    assert reset.position_m == pytest.approx(60.0, abs=3.0)
    assert 7.0 < reset.t < 9.0
    assert METRICS["estimator_resets"].of(JudgedFlight.read(tmp_path)) == 1
    verdict = outcome(logs)
    assert verdict.estimator_resets == 1
    assert verdict.as_json()["contacts"]["hits"] == 0


def test_without_odometry_resets_are_unknown(tmp_path):
    recorder = Recorder(tmp_path, ORIGIN, lambda *_: NOTHING, CameraModel())
    (tmp_path / "decisions.jsonl").write_text("")
    recorder.begin(5, 300.0)
    recorder.end("cap")
    recorder.close()
    assert METRICS["estimator_resets"].of(JudgedFlight.read(tmp_path)) is None
    assert "estimator_resets" not in outcome(read(tmp_path)).as_json()


def test_a_reboot_in_flight_does_not_set_the_time_of_the_record_back(tmp_path):
    (tmp_path / "decisions.jsonl").write_text("")
    recorder = EstimateRecorder(tmp_path)
    recorder.begin(300_000_000, 300.0)
    for time_ms in (300_000, 307_000, *range(1_000, 3_000, 50)):  # a reboot shows in many stamps
        recorder.telemetry(PACKER.pack(dialect.MAVLink_local_position_ned_message(time_ms, 1, 0, -2, 0, 0, 0)))
    recorder.end("error", "the vehicle has rebooted")
    recorder.close()
    logs = read(tmp_path)
    assert [pose.t for pose in logs.poses] == [0.0, 7.0]
    assert logs.end is not None
    assert logs.end.t == 7.0


def test_values_that_are_not_finite_stay_out_of_the_record(tmp_path):
    (tmp_path / "decisions.jsonl").write_text("")
    recorder = EstimateRecorder(tmp_path)
    recorder.begin(1_000_000, 300.0)
    for n, value in enumerate((math.nan, 1.0, math.inf, 2.0)):
        time_ms = 1000 + 500 * n
        recorder.telemetry(
            PACKER.pack(dialect.MAVLink_attitude_message(time_ms, 0, 0, 0 if n == 1 else math.nan, 0, 0, 0))
            + odometry(time_ms / 1000, n, x=value)
            + PACKER.pack(dialect.MAVLink_local_position_ned_message(time_ms, value, 0, -2, 0, 0, 0))
        )
    recorder.end("cap")
    recorder.close()
    logs = read(tmp_path)
    assert [(pose.position_ned[0], pose.yaw_deg) for pose in logs.poses] == [(1.0, 0.0), (2.0, 0.0)]
    (reset,) = logs.resets
    assert reset.count == 2  # from the first finite message to the next
