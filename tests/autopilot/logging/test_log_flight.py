"""The flight log is a ULog file from arming to disarming, in the vehicle's time. pyulog can read it."""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyulog import ULog
from pyulog.px4 import PX4ULog

from autopilot.logging.flight_log import LogDirectory
from autopilot.logging.topics import TABLE
from foundation.errors import UsageError
from foundation.sensors import ACTUATORS
from tests.autopilot.commander_bench import AIRFRAME, Bench


def fly_logged(folder: Path, **parameters: float) -> Bench:
    """Fly a short flight with a log. The actuator outputs have fixed values for turning rotors."""
    actuators = np.zeros(1, ACTUATORS)[0]
    bench = Bench(profile="minimal", log_dir=folder, actuators=actuators)
    for name, value in parameters.items():
        bench.autopilot.parameters.set(name, value)
    actuators["armed"] = 1
    actuators["command"][:4] = (0.5, 0.6, 0.7, 0.8)
    bench.fly(5.0)
    bench.autopilot.parameters.set("MPC_LAND_SPEED", 1.0)
    bench.client.velocity(1.0, 0.0, 0.0)
    bench.commander.set_mode("LAND")
    bench.until(lambda: not bench.commander.armed, 60)
    bench.run(0.1)
    return bench


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[Bench, ULog]:
    folder = tmp_path_factory.mktemp("log")
    bench = fly_logged(folder)
    return bench, ULog(str(folder / "log001.ulg"))


def data(log: ULog, topic: str) -> dict[str, Any]:
    return dict(log.get_dataset(topic).data)


def test_log_spans_the_time_between_arming_and_disarming(flight: tuple[Bench, ULog]) -> None:
    bench, log = flight
    assert bench.log.directory.active is None
    status = data(log, "vehicle_status")
    assert status["arming_state"][0] == 2
    assert status["arming_state"][-1] == 1
    assert not log.file_corruption
    assert not log.dropouts
    assert log.start_timestamp == status["timestamp"][0] > 1_000_000
    assert bench.log.unpacked == 0


def test_every_topic_with_a_source_is_logged_at_its_rate(flight: tuple[Bench, ULog]) -> None:
    _, log = flight
    seconds = (log.last_timestamp - log.start_timestamp) * 1e-6
    present = {d.name for d in log.data_list}
    assert present >= {t.name for t in TABLE} - {"distance_sensor"}  # the bench has no rangefinder
    for topic in TABLE:
        if topic.name in present and topic.rate_hz > 2:
            count = len(data(log, topic.name)["timestamp"])
            # the setpoint topics pause while the rotors idle before take-off; 20 ms ticks make 40 ms of 25 Hz
            assert 0.8 * topic.rate_hz * seconds - 30 <= count <= topic.rate_hz * seconds + 2, topic.name


def test_logged_values_match_the_flight(flight: tuple[Bench, ULog]) -> None:
    _, log = flight
    position = data(log, "vehicle_local_position")
    assert position["z"].min() == pytest.approx(-5.0, abs=0.5)
    assert position["z"][-1] == pytest.approx(0.0, abs=0.1)
    assert np.all(np.diff(position["timestamp"].astype(np.int64)) > 0)
    assert data(log, "actuator_motors")["control[2]"][10] == pytest.approx(0.7)
    assert data(log, "actuator_outputs")["output[3]"][10] == pytest.approx(1800.0)
    assert data(log, "battery_status")["voltage_v"][-1] == pytest.approx(16.0)
    assert {17, 4, 18} <= set(data(log, "vehicle_status")["nav_state"].tolist())  # take-off, hold, land
    assert log.initial_parameters["MIS_TAKEOFF_ALT"] == 5.0
    assert isinstance(log.initial_parameters["SDLOG_MODE"], int)
    assert [(name, value) for _, name, value in log.changed_parameters] == [("MPC_LAND_SPEED", 1.0)]
    assert log.msg_info_dict["sys_name"] == "DroneCATS"
    assert log.msg_info_dict["ver_hw"] == AIRFRAME.name


def test_status_texts_are_logged(flight: tuple[Bench, ULog]) -> None:
    _, log = flight
    levels = {m.message: m.log_level_str() for m in log.logged_messages}
    assert levels == dict.fromkeys(levels, "INFO")
    assert any("isarmed" in text for text in levels)


def test_px4_tools_accept_the_log(flight: tuple[Bench, ULog]) -> None:
    _, log = flight
    px4 = PX4ULog(log)
    px4.add_roll_pitch_yaw()
    assert px4.get_mav_type() == "Quadrotor"
    assert np.isfinite(data(log, "vehicle_attitude")["yaw"]).all()


def test_equal_flights_give_equal_log_bytes(flight: tuple[Bench, ULog], tmp_path: Path) -> None:
    bench, _ = flight
    fly_logged(tmp_path)
    assert (tmp_path / "log001.ulg").read_bytes() == (bench.log.directory.folder / "log001.ulg").read_bytes()


def test_a_log_cut_within_its_last_60_bytes_is_readable(flight: tuple[Bench, ULog], tmp_path: Path) -> None:
    whole = (flight[0].log.directory.folder / "log001.ulg").read_bytes()
    cut = tmp_path / "cut.ulg"
    for size in range(len(whole) - 60, len(whole), 7):
        cut.write_bytes(whole[:size])
        assert ULog(str(cut)).get_dataset("vehicle_attitude")


@pytest.mark.parametrize(("mode", "logs"), [(-1, 0), (0, 2), (1, 2), (2, 1)])
def test_sdlog_mode_selects_when_a_log_is_written(tmp_path: Path, mode: int, logs: int) -> None:
    bench = Bench(profile="minimal", log_dir=tmp_path)
    bench.autopilot.parameters.set("SDLOG_MODE", mode)
    bench.run(1.0)
    assert (bench.log.directory.active is not None) == (mode in (1, 2))  # only these log before arming
    for _ in range(2):
        assert bench.commander.arm() == 0
        bench.run(0.5)
        bench.commander.disarm(force=True)
        bench.run(0.5)
    assert len(bench.log.directory.logs()) == logs
    assert (bench.log.directory.active is not None) == (mode == 2)
    bench.autopilot.close()
    for log in bench.log.directory.logs():
        assert ULog(str(log.path)).data_list


def test_log_numbers_continue_after_a_restart(tmp_path: Path) -> None:
    (tmp_path / "log007.ulg").write_bytes(b"old")
    (tmp_path / "notes.txt").write_bytes(b"not a log")
    bench = Bench(profile="minimal", log_dir=tmp_path)
    bench.commander.arm()
    bench.run(0.1)
    assert [log.path.name for log in LogDirectory(tmp_path).logs()] == ["log007.ulg", "log008.ulg"]


@pytest.mark.parametrize(("most", "kept"), [(0, [1, 2, 3, 4]), (2, [3, 4]), (1, [4])])
def test_the_oldest_logs_are_deleted_for_new_logs(tmp_path: Path, most: int, kept: list[int]) -> None:
    (tmp_path / "notes.txt").write_bytes(b"not a log")
    bench = Bench(profile="minimal", log_dir=tmp_path)
    bench.autopilot.parameters.set("SDLOG_DIRS_MAX", most)
    bench.run(1.0)
    for _ in range(4):
        assert bench.commander.arm() == 0
        bench.run(0.2)
        bench.commander.disarm(force=True)
        bench.run(0.2)
    assert [log.path.name for log in LogDirectory(tmp_path).logs()] == [f"log{k:03d}.ulg" for k in kept]
    assert (tmp_path / "notes.txt").exists()


def test_a_full_disk_causes_a_marked_dropout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(profile="minimal", log_dir=tmp_path)
    bench.commander.arm()
    bench.run(0.6)
    write = os.write
    monkeypatch.setattr("autopilot.logging.flight_log.os.write", lambda file, data: write(file, data[:11]))
    bench.run(2.0)
    assert bench.log.failed
    assert bench.commander.armed
    monkeypatch.undo()
    bench.run(1.0)
    bench.commander.disarm(force=True)
    bench.run(0.1)
    log = ULog(str(tmp_path / "log001.ulg"))
    assert not log.file_corruption
    assert len(log.dropouts) == 1
    assert 1500 <= log.dropouts[0].duration <= 3000


def test_a_deleted_log_folder_does_not_stop_the_flight(tmp_path: Path) -> None:
    bench = Bench(profile="minimal", log_dir=tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    bench.client.forget()
    bench.commander.arm()
    bench.run(3.0)
    assert sum(text.startswith("Flight log not written: ") for text in bench.client.texts()) == 1
    bench.fly(3.0)
    assert bench.log.failed
    assert bench.log.directory.active is None


def test_a_log_folder_that_is_a_file_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=re.escape(str(tmp_path / "file"))):
        LogDirectory(tmp_path / "file")
