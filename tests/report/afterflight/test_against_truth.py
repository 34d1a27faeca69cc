"""Tests that the distance between estimate and truth does not depend on the tick at which an episode begins."""

import json
import re

import pytest

from dronecats.report.afterflight import against_truth
from foundation.errors import UsageError

ORIGIN = (47.397742, 8.545594, 488.0)
SPEED_MPS = 1.2


def folder_of(tmp_path, true_s, estimated_s):
    """Write an episode that flies north at a constant speed. Its estimate is 0.3 m too far east."""
    poses = [
        {"kind": "pose", "t": t, "drone": 0, "position_ned": [SPEED_MPS * t, 0.0, -2.0], "yaw_deg": 0.0,
         "target_ned": [9.0, 0.0, 0.0], "distance_m": 1.0, "visible": True}
        for t in true_s
    ]  # fmt: skip
    estimates = [
        {"kind": "pose", "t": t, "drone": 0, "position_ned": [SPEED_MPS * t, 0.3, -2.0],
         "position_std_m": [0.2, 0.2, 0.2], "distance_m": None, "visible": None}
        for t in estimated_s
    ]  # fmt: skip
    head = {"kind": "estimate", "origin": ORIGIN}
    for name, rows in (("truth.jsonl", poses), ("estimate.jsonl", [head, *estimates]), ("decisions.jsonl", [])):
        (tmp_path / name).write_text("".join(json.dumps(row) + "\n" for row in rows))
    return tmp_path


@pytest.mark.parametrize("late_s", [0.0, 0.01, 0.018])
def test_an_episode_may_begin_between_two_poses(tmp_path, late_s):
    half = [0.5 * k for k in range(20)]
    comparison = against_truth(folder_of(tmp_path, [t + late_s for t in half], half), ORIGIN)
    assert comparison["poses"] >= 19
    assert comparison["rms_m"] == pytest.approx(0.3, abs=1e-3)
    assert comparison["max_m"] == pytest.approx(0.3, abs=1e-3)
    assert comparison["within_2_std"] == 1.0


def test_a_gap_in_the_truth_is_not_bridged(tmp_path):
    half = [0.5 * k for k in range(20)]
    true = [t + 0.01 for t in half if not 3.0 < t < 6.0]
    assert against_truth(folder_of(tmp_path, true, half), ORIGIN)["poses"] == 19 - 6


def test_two_logs_without_common_time_are_an_error(tmp_path):
    with pytest.raises(UsageError, match=re.escape(str(tmp_path))):
        against_truth(folder_of(tmp_path, [0.01, 0.51], [5.0, 5.5]), ORIGIN)
