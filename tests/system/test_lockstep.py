"""Whole flights through the command line on the lockstep clock."""

import collections
import json

import pytest

from dronecats.cli.main import main
from tests.support.flight import fly_beginning, fly_simulated
from tests.support.json_lines import rows

FLIGHT_PICTURE = True  # keeps flight.png, which other test modules skip


@pytest.fixture(scope="module")
def fly(tmp_path_factory):
    """A function that flies with the given arguments and returns (result, episode folder). It caches flights."""
    flights = {}

    def run(capsys, *arguments, again=0):
        key = (*arguments, again)
        if key not in flights:
            out = tmp_path_factory.mktemp("run")
            flights[key] = fly_simulated(capsys, out, "--speed", "max", *arguments)
        return flights[key]

    return run


FIXED = ("--latency", "fixed:0.5", "--seed", "3")


def test_vision_pilot_succeeds_and_writes_a_complete_run_folder(fly, capsys):
    result, folder = fly(capsys, "--pilot", "vision", *FIXED)
    assert result["success"]
    assert result["ne_m"] <= 5.0
    assert result["real_time_factor"] > 1.0
    names = {path.name for path in folder.iterdir()}
    assert {"episode.json", "decisions.jsonl", "truth.jsonl", "flight.tlog", "frames", "verdict.json"} <= names
    assert (folder / "flight.png").stat().st_size > 50_000
    assert len(list((folder / "frames").iterdir())) >= result["steps"]
    run = json.loads((folder.parent / "run.json").read_text())
    assert len(run["prompt_sha256"]) == 64
    assert run["clock"] == "lockstep"
    assert run["served_rate_hz"] > 0
    for decision in rows(folder / "decisions.jsonl"):
        assert decision["t_decided"] == pytest.approx(decision["t_frame"] + 0.5, abs=0.11)


def test_judge_recomputes_the_verdict_from_the_files(fly, capsys):
    result, folder = fly(capsys, "--pilot", "vision", *FIXED)
    assert main(["judge", str(folder.parent), "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)["episodes"][result["episode"]]
    assert verdict["stored_agrees"] is True
    assert verdict["ne_m"] == result["ne_m"]
    assert verdict["contradictions"] == []
    assert verdict["censored"] is result["censored"] is True
    assert verdict["false_declarations"] == result["false_declarations"] == result["declarations"] - 1
    begin = rows(folder / "truth.jsonl")[0]
    assert (begin["kind"], begin["cap_s"]) == ("begin", 300.0)
    assert main(["judge", str(folder), "--delta", "0.5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["episodes"][folder.name]["outcome"] == "censored"


def test_logs_are_identical_for_the_same_seed_and_differ_for_another(tmp_path):
    first, second, other = (
        fly_beginning(tmp_path / name, 8.0, "--pilot", "vision", "--seed", seed)
        for name, seed in (("first", "3"), ("second", "3"), ("other", "4"))
    )
    assert json.loads((first.parent / "run.json").read_text())["flight"]["latency"] == "fixed:0.5"  # the default
    for name in ("truth.jsonl", "decisions.jsonl"):
        assert (first / name).read_bytes() == (second / name).read_bytes()
        assert (first / name).read_bytes() != (other / name).read_bytes()


def test_the_seed_of_the_record_changes_the_flight(tmp_path):
    from episodes.records import catalogue

    record = json.loads(catalogue.load("residential-approaching-02").to_json())
    drawn = []
    for seed in (record["seed"], record["seed"] + 1):
        path = tmp_path / f"{seed}.json"
        path.write_text(json.dumps({**record, "id": "reseeded", "seed": seed}))
        folder = fly_beginning(tmp_path / f"run-{seed}", 2.0, "--pilot", "oracle", "--episode", str(path))
        drawn.append((folder / "truth.jsonl").read_bytes())
    assert drawn[0] != drawn[1]


def test_pymavlink_reads_the_complete_tlog(fly, capsys):
    from pymavlink import mavutil

    _, folder = fly(capsys, "--pilot", "vision", *FIXED)
    tlog = folder / "flight.tlog"
    log, messages, modes = mavutil.mavlink_connection(str(tlog)), [], []
    while (message := log.recv_msg()) is not None:
        messages.append(message)
        if (message.get_type(), message.get_srcComponent()) == ("HEARTBEAT", 1):
            modes.append(log.flightmode)
    assert sum(8 + len(message.get_msgbuf()) for message in messages) == tlog.stat().st_size  # no byte is skipped
    counts = collections.Counter(message.get_type() for message in messages)
    assert counts.keys() >= {"HIL_STATE_QUATERNION", "ATTITUDE", "GLOBAL_POSITION_INT", "SYS_STATUS"}
    assert "BAD_DATA" not in counts
    times = [message._timestamp for message in messages]
    assert times == sorted(times)
    spent_s = times[-1] - times[0]
    assert counts["HIL_STATE_QUATERNION"] == pytest.approx(50.0 * spent_s, rel=0.02)
    assert counts["ATTITUDE"] == pytest.approx(5.0 * spent_s, rel=0.1)
    assert spent_s <= counts["HEARTBEAT"] <= spent_s + 10  # one per second, and one at every change
    assert list(dict.fromkeys(modes)) == ["LOITER", "TAKEOFF", "OFFBOARD", "LAND"]  # MAVExplorer's names of PX4's modes


@pytest.mark.parametrize(
    "episode", ["residential-approaching-02", "residential-searching-01", "residential-search-and-track-01"]
)
def test_the_oracle_succeeds_in_three_cells(fly, capsys, episode):
    result, _ = fly(capsys, "--pilot", "oracle", "--episode", episode)
    assert result["success"]


@pytest.mark.slow
def test_the_blind_pilot_flies_until_the_time_cap_and_fails(fly, capsys):
    result, folder = fly(capsys, "--pilot", "blind", "--latency", "fixed:0.5")
    assert not result["success"]
    assert result["outcome"] == "failure"
    assert result["declarations"] == 0
    assert result["sim_seconds"] >= 300.0
    poses = rows(folder / "truth.jsonl", "pose")
    assert len(poses) == pytest.approx(601, abs=2)  # 2 Hz over 300 s
