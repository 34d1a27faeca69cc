"""Tests verdicts of flights without a measured truth: estimated distances with their errors, and never a success."""

import json
import re
from pathlib import Path
from typing import Any, cast

import pytest

from dronecats.judge import episode
from dronecats.judge.diagnostics import distances_sentence
from foundation.run_folder.results import Distances
from tests.judge.episode_logs import judge_folder, write_verdict

TARGET = {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_m": 480.0, "std_m": 0.02}
HEAD = {"kind": "estimate", "source": "flight.tlog", "target": TARGET}


def row(kind: str, t: float, distance_m: float | None, std_m: float | None, **more) -> dict[str, Any]:
    place = {"position_ned": [0.0, 0.0, 0.0], "distance_m": distance_m, "distance_std_m": std_m, "visible": None}
    return {"kind": kind, "t": t, "drone": 0, **place, **more}


def write_flight(
    folder: Path, estimate: list[dict[str, Any]], declared: list[int], *, source: str | None = "estimate", end="cap"
) -> Path:
    """Write a flight whose decision k uses frame k at k seconds. The decisions in `declared` are declarations."""
    folder.mkdir(exist_ok=True)
    begin = {"kind": "begin", "t": 0.0, "t0_us": 0} | ({"source": source} if source else {})
    truth = [begin, {"kind": "end", "t": 300.0, "reason": end, "error": None}]
    decisions = [
        {"step": k, "drone": 0, "frame_id": k, "t_frame": k, "t_decided": k + 0.5,
         "action": {"action": "finished" if k in declared else "think"}}
        for k in range(4)
    ]  # fmt: skip
    for name, rows in (("truth.jsonl", truth), ("decisions.jsonl", decisions), ("estimate.jsonl", estimate)):
        (folder / name).write_text("".join(json.dumps(r) + "\n" for r in rows))
    return folder


def frames(*estimates: tuple[float | None, float | None]) -> list[dict[str, Any]]:
    return [row("frame", float(k), *t, frame_id=k) for k, t in enumerate(estimates)]


@pytest.mark.parametrize(
    ("distance", "within"),
    [
        ((0.1, 0.1), True), ((4.0, 0.5), True), ((4.0, 0.51), None), ((5.0, 0.0), True), ((5.0, 0.1), None),
        ((6.0, 0.5), None), ((6.01, 0.5), False), ((50.0, None), None), ((None, None), None),
    ],
)  # fmt: skip
def test_within_radius_needs_two_standard_deviations_and_is_never_a_success(tmp_path, distance, within) -> None:
    verdict = judge_folder(write_flight(tmp_path / "e", [HEAD, *frames((9, 1), distance, (9, 1), (9, 1))], [1]))
    assert (verdict["outcome"], verdict["success"], verdict["ne_m"]) == ("distance only", None, None)
    (declared,) = verdict["distances"]["declarations"]
    assert declared == {
        "step": 1,
        "drone": 0,
        "t": 1.5,
        "distance_m": distance[0],
        "std_m": distance[1],
        "within": within,
    }


def test_closest_and_dwell_come_from_the_poses_and_the_last_action_from_its_frame(tmp_path: Path) -> None:
    poses = [row("pose", k / 2, abs(8.0 - k), 0.5) for k in range(17)]
    measured = judge_folder(write_flight(tmp_path / "e", [HEAD, *poses, *frames((9, 1), (8, 1), (7, 1), (3, 1))], []))[
        "distances"
    ]
    assert measured["closest"] == {"t": 4.0, "distance_m": 0.0, "std_m": 0.5, "within": True}
    assert measured["dwell_s"] == pytest.approx(5.5)
    assert (measured["last_action"]["distance_m"], measured["last_action"]["within"]) == (3, True)
    assert "4.0 s" in distances_sentence(cast(Distances, episode.verdict_of(tmp_path / "e").distances), 5.0)


def test_without_an_estimate_or_a_target_the_outcome_is_unknown(tmp_path: Path) -> None:
    without_target = write_flight(tmp_path / "e", [{**HEAD, "target": None}, *frames((None, None))], [0])
    assert judge_folder(without_target)["outcome"] == "unknown"
    (without_target / "estimate.jsonl").unlink()
    verdict = judge_folder(without_target)
    assert (verdict["outcome"], verdict["distances"]) == ("unknown", None)


def test_a_measured_truth_is_judged_without_the_estimate(tmp_path: Path) -> None:
    folder = write_flight(tmp_path / "e", [HEAD, *frames((0.1, 0.1))], [0], source=None)
    verdict = judge_folder(folder)
    assert verdict["outcome"] == "error"  # no frame was measured in truth.jsonl
    assert "distances" not in verdict


def test_an_interrupted_flight_is_an_error_and_keeps_its_distances(tmp_path: Path) -> None:
    verdict = judge_folder(write_flight(tmp_path / "e", [HEAD, *frames((1, 0.1))], [0], end="interrupted"))
    assert verdict["outcome"] == "error"
    assert verdict["distances"]["declarations"][0]["within"] is True


def test_the_stored_verdict_equals_the_derived_one(tmp_path: Path) -> None:
    folder = write_flight(tmp_path / "e", [HEAD, *frames((9, 1), (2, 0.5), (1, 0.5))], [1, 2])
    stored = write_verdict(folder)
    assert judge_folder(folder)["stored_agrees"] is True
    assert stored == json.loads((folder / "verdict.json").read_text())
    sentence = distances_sentence(cast(Distances, episode.verdict_of(folder).distances), 5.0)
    assert re.search(r"1\.5 s.*2\.00 ± 0\.50 m.* 5 m.*\b2\b", sentence)
    assert "SUCCESS" not in sentence


@pytest.mark.parametrize(
    "damaged",
    [
        [row("pose", 0.0, 1.0, 0.1)],
        [HEAD, row("pose", 0.0, 1.0, -0.1), HEAD],
        [HEAD, {**row("pose", 0.0, 1.0, 0.1), "visible": "yes"}, HEAD],
        [HEAD, {"kind": "end", "reason": "cap"}, HEAD],
    ],
)
def test_a_damaged_estimate_is_an_error_that_names_its_file(tmp_path: Path, damaged: list[dict[str, Any]]) -> None:
    folder = write_flight(tmp_path / "e", damaged, [0])
    verdict = judge_folder(folder)
    assert verdict["outcome"] == "error"
    assert "estimate.jsonl" in verdict["error"]


def test_dwell_omits_gaps_of_the_trace_and_sorts_poses_by_time(tmp_path: Path) -> None:
    poses = [row("pose", t, 3.0, 0.5) for t in (10.5, 0.0, 0.5, 1.0, 10.0)]
    measured = judge_folder(write_flight(tmp_path / "e", [HEAD, *poses, *frames((9, 1))], []))["distances"]
    assert measured["dwell_s"] == pytest.approx(1.5)
