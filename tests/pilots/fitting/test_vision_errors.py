"""Tests the fit of the noisy pilot's errors to logged decisions, and the file that this pilot reads."""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.pilots.fitting import vision_errors
from dronecats.pilots.fitting.vision_errors import LabelledDecision, OneDroneFlight
from dronecats.pilots.oracle import noisy
from foundation.camera import CameraModel
from tests.judge.episode_logs import BEGIN, END, decision, write
from tests.support.refusal import refusal

CAMERA = CameraModel()
PAINT, INSCRIPTION = "go to the red car", "go to the sign that reads WEST"
PLACE = "go to the bench left of the fountain"


def labelled(taken, distance_m=10.0, *, seen=True, depth=None) -> LabelledDecision:
    error_px, astray_m = (3.0, -2.0) if depth is not None else None, 9.0 if taken == "else" else None
    return LabelledDecision(taken, seen, distance_m, error_px, depth, astray_m)


def decided(step, kind, **more):
    return decision(step, step, 2.0 * step + 0.5) | {"t_frame": 2.0 * step} | {"action": {"action": kind, **more}}


def pictured(step, target_frd, visible=True):
    """Return the truth of a step's picture. The distance is the length of `target_frd`."""
    return {"kind": "frame", "frame_id": step, "t": 2.0 * step, "drone": 0, "distance_m": math.hypot(*target_frd),
            "visible": visible, "target_frd": list(target_frd), "oracle_depth_m": target_frd[0] - 1.0}  # fmt: skip


def write_flight(folder: Path, decisions, truth, instruction=PAINT):
    write(folder, decisions, [BEGIN, *truth, END])
    (folder / "episode.json").write_text(json.dumps({"id": folder.name, "instruction": instruction}))
    return folder


def write_goes(folder: Path, instruction):
    """Write a flight with six decisions to go to the target."""
    steps = range(6)
    write_flight(
        folder,
        [decided(k, "go", point=[500.0 + k, 500.0], depth_m=11.0 + k) for k in steps],
        [pictured(k, (20.0 - k, 0.0, 0.5)) for k in steps],
        instruction,
    )


def test_a_decision_is_labelled_by_the_truth_of_its_picture(tmp_path):
    x, y = 500.0 + 500.0 * 0.25, 500.0 + 1000.0 * 640.0 / 720.0 * 0.05  # the image point of a target at (20, 5, 1) m
    rows: list[tuple[str, dict[str, Any], tuple[float, float, float], bool, str]] = [
        ("go", {"point": [x, y], "depth_m": 22.0}, (20.0, 5.0, 1.0), True, "target"),
        ("go", {"point": [x + 200.0, y], "depth_m": 22.0}, (20.0, 5.0, 1.0), True, "else"),
        ("go", {"point": [x, y], "depth_m": 22.0}, (20.0, 5.0, 1.0), False, "else"),
        ("go", {"point": [x, y], "depth_m": 20.0}, (20.0, 5.0, 1.0), True, "nothing"),  # vision's code for wandering
        ("rotate", {"angle_deg": 60.0}, (20.0, 5.0, 1.0), True, "nothing"),
        ("finished", {}, (5.5, 0.0, 1.0), True, "target"),
        ("finished", {}, (20.0, 0.0, 1.0), True, "claim"),
    ]
    folder = write_flight(
        tmp_path / "run" / "e",
        [decided(k, kind, **more) for k, (kind, more, *_) in enumerate(rows)],
        [pictured(k, at, seen) for k, (_, _, at, seen, _) in enumerate(rows)],
    )
    decisions = [vision_errors.label(step) for step in JudgedFlight.read(folder).steps]
    assert [row.taken for row in decisions if row] == [taken for *_, taken in rows]
    assert decisions[0] is not None
    assert decisions[0].depth == pytest.approx(math.log(22.0 / 20.0))
    assert decisions[0].error_px == pytest.approx((0.0, 0.0), abs=1e-6)


def test_attention_shares_depend_on_the_previous_choice():
    flight = OneDroneFlight(True, tuple(map(labelled, ("nothing", "target", "target", "else", "else", "claim"))))
    attention = vision_errors.attention([flight] * 200)
    assert attention.found[1] == pytest.approx(1 / 4, abs=0.01)  # of four steps that follow no target, one finds it
    assert attention.kept[1] == pytest.approx(1 / 2, abs=0.01)
    assert attention.strays == pytest.approx(1 / 2, abs=0.01)  # the first step, and the one after the target
    assert (attention.stays, attention.claims) == pytest.approx((1 / 2, 1 / 2), abs=0.01)
    assert attention.found[0] == pytest.approx(attention.found[1], abs=0.01)  # no near steps: the overall share


def test_depth_errors_are_split_into_spreads_between_and_within_flights():
    flights = [
        OneDroneFlight(True, tuple(labelled("target", 20.0, depth=0.1 + between + d) for d in (-0.04, 0.0, 0.04)))
        for between in (-0.2, -0.1, 0.0, 0.1, 0.2)
    ]
    errors = vision_errors.errors_of([*flights, OneDroneFlight(False, (labelled("else"),))])
    assert errors.depth == pytest.approx(0.1, abs=1e-6)
    assert errors.depth_step == pytest.approx(0.04, abs=0.01)
    assert errors.depth_flight == pytest.approx(0.136, abs=0.02)
    assert errors.mistaken == pytest.approx(1 / 6, abs=1e-3)
    assert errors.lost.strays > errors.sure.strays


def test_a_run_without_one_kind_of_command_is_rejected(tmp_path):
    write_goes(tmp_path / "run" / "paint", PAINT)
    assert "place or inscription" in refusal(vision_errors.fit_run, tmp_path / "run")
    write_goes(tmp_path / "run" / "inscription", INSCRIPTION)
    write_flight(tmp_path / "run" / "place", [decided(0, "think")], [pictured(0, (20.0, 0.0, 0.5))], PLACE)
    assert "named by place." in refusal(vision_errors.fit_run, tmp_path / "run")  # a flight without a depth


def test_the_command_writes_the_file_that_the_pilot_reads(tmp_path):
    for instruction in (PAINT, PLACE, INSCRIPTION):
        write_goes(tmp_path / "run" / noisy.named_by(instruction), instruction)
    command = [sys.executable, "-m", "dronecats.pilots.fitting", "vision-errors", str(tmp_path / "run")]
    command += ["--out", str(tmp_path)]
    done = subprocess.run(command, cwd=Path(__file__).parents[3], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    out = tmp_path / "vision_errors.json"
    eyes = json.loads(out.read_text())["eyes"]
    assert {name: errors["flights"] for name, errors in eyes.items()} == {"paint": 1, "place": 1, "inscription": 1}
    assert json.loads(done.stdout) == json.loads(out.read_text())
