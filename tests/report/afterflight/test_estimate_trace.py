"""Compares the trace computed after landing with the truth. The logger of the flight never receives the truth."""

import bisect
import json
import math
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dronecats.cli.main import main
from dronecats.flight.logger.recorder import EstimateRecorder
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.episode_world import load_world, origin
from dronecats.flight.sitl.simulation import SimulatedVehicle, build
from dronecats.flight.stages.lockstep import Lockstep
from dronecats.judge.episode import verdict_of
from dronecats.report.afterflight import (
    EstimatorLog,
    SurveyedTarget,
    derive,
    from_telemetry,
    from_ulog,
    rejudge,
    target_from,
    target_of,
)
from dronecats.report.recorded.telemetry import telemetry
from foundation.errors import UsageError
from foundation.frames import geodetic_to_ned, ned_to_geodetic
from foundation.mavlink import Packer, Parser, dialect
from foundation.run_folder.layout import ESTIMATE
from foundation.run_folder.reading import read
from foundation.setpoints import Hold, Setpoint, Turn, Velocity
from foundation.truth import TruthSample, truth_sample
from hil.link.link import Link
from tests.support.refusal import refusal

EPISODE = "campus-approaching-01"
ROUND: list[tuple[Setpoint, float]] = [
    (Velocity(1.2, None), 4.0), (Hold(), 1.5), (Turn(math.radians(60.0)), 1.0), (Velocity(1.2, 0.3), 3.0),
]  # fmt: skip
STEPS = ROUND * 2


class Truth:
    """Keeps every truth sample."""

    def __init__(self, map_origin) -> None:
        self.samples: list[TruthSample] = []
        self._origin, self._parser = map_origin, Parser()

    def feed(self, data: bytes) -> None:
        for message in self._parser.feed(data):
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
                self.samples.append(truth_sample(message, self._origin))

    def at(self, time_us: float):
        index = bisect.bisect_left(self.samples, time_us, key=lambda s: s.time_us)
        return np.array(self.samples[min(index, len(self.samples) - 1)].position_ned)


class Flown:
    """A flight's folder, its truth and the ULog of the vehicle."""

    def __init__(self, folder: Path, truth: Truth, ulog: Path, map_origin) -> None:
        self.folder, self.truth, self.ulog, self.origin = folder, truth, ulog, map_origin
        begin = read(folder).begin
        assert begin is not None
        self.t0_us = begin.t0_us

    def true(self, t: float):
        """Return the true position at a time of the episode, m, NED about the map's origin."""
        return self.truth.at(self.t0_us + t * 1e6)


pytestmark = pytest.mark.slow("one flight of a minute in real time, which all tests read")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory):
    folder, state = tmp_path_factory.mktemp("flight"), tmp_path_factory.mktemp("vehicle")
    world = load_world(EPISODE)
    truth = Truth(origin(world))
    config = SimulatorConfig(episode=EPISODE, seed=5)
    simulation = build(partial(SimulatedVehicle, state_dir=state / "vehicle-1"), world, config)
    clock = Lockstep(simulation)
    clock.follow(truth.feed)
    _fly(folder, Link(clock.transport(0, "onboard")))
    for vehicle in simulation.vehicles:
        vehicle.close()
    return Flown(folder, truth, next((state / "vehicle-1" / "log").glob("*.ulg")), origin(world))


def _fly(folder: Path, link: Link) -> None:
    """Fly STEPS and write the logs of a vehicle that this process did not start. Decisions 2 and 7 declare."""
    recorder = EstimateRecorder(folder)
    link.listeners.append(lambda m: recorder.telemetry(bytes(m.get_msgbuf())))
    link.connect()
    link.wait_for(lambda state: state.healthy, 90.0, "becoming ready to arm")
    link.arm()
    link.order("take-off", dialect.MAV_CMD_NAV_TAKEOFF)
    link.wait_for(lambda state: state.mode == "HOLD" and state.landed is False, 60.0, "reaching take-off height")
    link.fly(Hold())
    link.start_offboard()
    t0_us = link.time_us
    recorder.begin(t0_us)
    with (folder / "decisions.jsonl").open("w") as decisions:
        for step, (setpoint, seconds) in enumerate(STEPS):
            action = {"action": "finished"} if step in (2, 7) else {"action": "think"}
            seen_s = (link.time_us - t0_us) / 1e6
            row = {"step": step, "drone": 0, "frame_id": 100 + step, "t_frame": seen_s, "t_decided": seen_s + 0.2}
            decisions.write(json.dumps({**row, "reply": json.dumps(action), "action": action, "error": None}) + "\n")
            link.fly(setpoint, seconds)
            link.wait(seconds)
    recorder.end("cap")
    link.set_mode("LAND")
    link.wait_for(lambda state: not state.armed, 60.0, "landing")
    link.wait(1.0)
    link.close()
    recorder.close()


def from_tlog(path: Path) -> EstimatorLog:
    return from_telemetry(telemetry(path, 0)[0], path)


def rows(flight: Flown, kind: str) -> list[dict[str, Any]]:
    return [row for row in map(json.loads, (flight.folder / ESTIMATE).read_text().splitlines()) if row["kind"] == kind]


def surveyed(flight: Flown, place, std_m: float = 0.02, altitude: bool = True) -> SurveyedTarget:
    latitude, longitude, height = ned_to_geodetic(*flight.origin, *place)
    return SurveyedTarget(latitude, longitude, height if altitude else None, std_m)


@pytest.mark.parametrize("source", ["tlog", "ulog"])
def test_trace_errors_are_below_three_standard_deviations(flight: Flown, source: str) -> None:
    logs = {name: (flight.folder / name).read_bytes() for name in ("truth.jsonl", "decisions.jsonl", "flight.tlog")}
    derive(flight.folder, ulog=flight.ulog if source == "ulog" else None)
    head, poses = rows(flight, "estimate")[0], rows(flight, "pose")
    assert head["source"] == ("flight.tlog" if source == "tlog" else flight.ulog.name)
    assert len(poses) >= 2 * sum(seconds for _, seconds in STEPS) - 1
    errors = []
    for pose in poses:
        place = geodetic_to_ned(*(*flight.origin, *ned_to_geodetic(*(*head["origin"], *pose["position_ned"]))))
        errors.append((np.array(place) - flight.true(pose["t"])) / pose["position_std_m"])
    assert np.abs(errors).max() < 3.0
    assert np.abs(errors).max() > 0.01  # an estimate is not exact
    assert all(0.05 < std < 5.0 for pose in poses for std in pose["position_std_m"])
    assert {name: (flight.folder / name).read_bytes() for name in logs} == logs


def test_each_decision_frame_has_a_pose_at_its_own_time(flight: Flown) -> None:
    derive(flight.folder)
    frames, decisions = rows(flight, "frame"), read(flight.folder).decisions
    assert [(f["frame_id"], f["t"]) for f in frames] == [(d.frame_id, round(d.t_frame, 6)) for d in decisions]
    moved = [np.subtract(f["position_ned"], frames[0]["position_ned"]) for f in frames]
    true = [flight.true(f["t"]) - flight.true(frames[0]["t"]) for f in frames]
    assert np.abs(np.subtract(moved, true)[:, :2]).max() < 0.5
    assert all(f["visible"] is None for f in frames)


def test_a_surveyed_target_gives_distances_and_never_a_success(flight: Flown) -> None:
    """The target is at the vehicle's position at a declaration: the distance is near zero, the visibility unknown."""
    when = read(flight.folder).decisions[7].t_frame
    derive(flight.folder, surveyed(flight, flight.true(when) + np.array([0.3, 0.0, 0.0])))
    verdict = verdict_of(flight.folder).as_json()
    assert verdict["outcome"] == "distance only"
    assert verdict["success"] is None
    assert verdict["ne_m"] is None
    measured = verdict["distances"]
    assert measured["visible"] is None
    assert [d["step"] for d in measured["declarations"]] == [2, 7]
    there = measured["declarations"][1]
    assert there["distance_m"] < 3.0 * there["std_m"]
    assert there["within"] is True
    assert measured["closest"]["distance_m"] <= there["distance_m"] + 0.7
    assert measured["dwell_s"] > 1.0


@pytest.mark.parametrize("altitude", [True, False])
def test_distance_errors_are_below_three_standard_deviations(flight: Flown, altitude: bool) -> None:
    place = flight.true(0.0) + np.array([20.0, 10.0, 6.0])
    derive(flight.folder, surveyed(flight, place, altitude=altitude))
    axes = 3 if altitude else 2
    for row in rows(flight, "pose") + rows(flight, "frame"):
        true_m = float(np.linalg.norm((flight.true(row["t"]) - place)[:axes]))
        assert abs(row["distance_m"] - true_m) < 3.0 * row["distance_std_m"]
    assert verdict_of(flight.folder).as_json()["distances"]["declarations"][0]["within"] is False


def test_the_trace_command_writes_a_new_verdict(flight: Flown, capsys: pytest.CaptureFixture[str]) -> None:
    target = surveyed(flight, flight.true(0.0))
    where = f"--target={target.latitude_deg},{target.longitude_deg}"
    assert main(["flightlog", "trace", str(flight.folder), where, "--target-std", "0.02"]) == 0
    assert json.loads((flight.folder / "verdict.json").read_text())["outcome"] == "distance only"
    assert main(["judge", str(flight.folder)]) == 0
    capsys.readouterr()
    assert main(["flightlog", "trace", str(flight.folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["outcome"] == "unknown"  # without a target there is no distance


def test_a_connected_flight_is_traced_and_a_flight_with_too_few_logs_is_unchanged(
    flight: Flown, tmp_path: Path
) -> None:
    messages: list[str] = []
    episode = {"run_dir": str(flight.folder), "outcome": "unknown", "success": None, "reason": "cap"}
    result = rejudge(episode, surveyed(flight, flight.true(0.0)), messages.append)
    assert (result["outcome"], result["success"], result["reason"]) == ("distance only", None, "cap")
    assert result["distances"]["closest"]["distance_m"] < 2.0
    assert len(messages) == 1
    assert rejudge(episode, None, messages.append)["outcome"] == "unknown"
    for log in ("decisions.jsonl", "truth.jsonl"):
        (tmp_path / log).touch()
    broken = {"run_dir": str(tmp_path), "outcome": "error", "success": False}
    assert rejudge(broken, None, messages.append) == broken
    assert len(messages) == 2


@pytest.mark.parametrize(
    "wrong", [["--target", "here"], ["--target-std", "1"], ["--target", "1,2", "--world", "blocks"]]
)
def test_fly_rejects_an_invalid_target_before_the_flight(wrong: list[str]) -> None:
    eyes = ["--truth", "udpin://127.0.0.1:0"] if "--world" in wrong else ["--camera", "x", "--instruction", "go"]
    assert main(["fly", "--connect", "udpin://127.0.0.1:0", *eyes, *wrong]) == 2


def test_the_target_may_come_from_episode_json(flight: Flown) -> None:
    target = surveyed(flight, flight.true(0.0), std_m=1.0)
    (flight.folder / "episode.json").write_text(json.dumps({"id": "x", "surveyed_target": target.as_json()}))
    try:
        derive(flight.folder)
        assert verdict_of(flight.folder).as_json()["distances"]["target"] == target.as_json()
        (flight.folder / "episode.json").write_text(json.dumps({"surveyed_target": {"latitude_deg": "north"}}))
        with pytest.raises(UsageError, match="latitude_deg"):
            derive(flight.folder)
    finally:
        (flight.folder / "episode.json").unlink()


def test_tlog_and_ulog_give_the_same_trace(flight: Flown) -> None:
    tlog, ulog = from_tlog(flight.folder / "flight.tlog"), from_ulog(flight.ulog)
    assert tlog.origin == pytest.approx(ulog.origin, abs=1e-3)
    at_us = flight.t0_us + 10e6
    places = [
        [np.interp(at_us, r.estimates.time_us, r.estimates.position_ned[:, axis]) for axis in range(3)]
        for r in (tlog, ulog)
    ]
    assert places[0] == pytest.approx(places[1], abs=0.1)
    assert tlog.yaw_deg(at_us) == pytest.approx(ulog.yaw_deg(at_us), abs=1.0)


def test_a_damaged_tlog_is_read_around_the_damage_and_other_systems_are_ignored(flight: Flown, tmp_path: Path) -> None:
    data = (flight.folder / "flight.tlog").read_bytes()
    stranger = Packer(7, 1).pack(dialect.MAVLink_local_position_ned_message(4_000_000_000, 9e9, 0, 0, 0, 0, 0))
    torn = tmp_path / "flight.tlog"
    torn.write_bytes(
        data[: len(data) // 2] + b"\x00" * 5 + data[len(data) // 2 + 40 :] + bytes(8) + stranger + data[-9:-3]
    )
    complete, read_back = from_tlog(flight.folder / "flight.tlog").estimates, from_tlog(torn).estimates
    assert 0.98 * len(complete.time_us) <= len(read_back.time_us) <= len(complete.time_us)
    assert np.abs(read_back.position_ned).max() < 1e3


def test_folders_without_a_flight_are_rejected(flight: Flown, tmp_path: Path) -> None:
    (tmp_path / "decisions.jsonl").write_text("")
    (tmp_path / "truth.jsonl").write_text("")
    with pytest.raises(UsageError, match=re.escape(str(tmp_path))):
        derive(tmp_path)
    (tmp_path / "truth.jsonl").write_text('{"kind": "begin", "t": 0.0, "t0_us": 1, "source": "estimate"}\n')
    with pytest.raises(UsageError, match=r"flight\.tlog"):
        derive(tmp_path)
    (tmp_path / "flight.tlog").write_bytes(b"nothing" * 100)
    with pytest.raises(UsageError, match="LOCAL_POSITION_NED"):
        derive(tmp_path)
    (tmp_path / "flight.tlog").write_bytes((flight.folder / "flight.tlog").read_bytes())
    (tmp_path / "truth.jsonl").write_text('{"kind": "begin", "t": 0.0, "t0_us": 9000000000, "source": "estimate"}\n')
    with pytest.raises(UsageError, match=r"flight\.tlog"):
        derive(tmp_path)
    with pytest.raises(UsageError, match="ULog"):
        from_ulog(tmp_path / "flight.tlog")
    with pytest.raises(UsageError, match=r"none\.ulg"):
        from_ulog(tmp_path / "none.ulg")


def test_invalid_targets_are_rejected() -> None:
    for wrong in ["", "1", "1,2,3,4", "north,east", "91,0", "0,181", "0,0,99999", "nan,0"]:
        assert "target" in refusal(target_from, wrong)


def test_a_target_survives_a_json_round_trip() -> None:
    assert target_from("47.39,8.54").altitude_m is None
    for target in (target_from("47.39,8.54,488.5", 0.02), target_from("-33,-70")):
        assert target_of(json.loads(json.dumps(target.as_json()))) == target
    wrongs: tuple[Any, ...] = (None, [], {}, {"latitude_deg": True, "longitude_deg": 0, "std_m": 1})
    for wrong in wrongs:
        with pytest.raises(UsageError):
            target_of(wrong)


def test_distance_and_its_standard_deviation() -> None:
    target = SurveyedTarget(0.0, 0.0, 0.0, std_m=0.3)
    assert target.distance((0, 0, 0), (3.0, 4.0, 0.0), (0.4, 0.4, 2.0)) == pytest.approx((5.0, 0.5))
    near = target.distance((0, 0, 0), (0.0, 0.1, 0.0), (0.4, 0.4, 1.2))
    assert near == pytest.approx((0.1, math.hypot(1.2, 0.3)))
    assert math.isnan(target.distance((0, 0, 0), (3.0, 4.0, 0.0), (math.nan,) * 3)[1])
