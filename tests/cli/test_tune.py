"""The command `dronecats tune`: its printed gains and margins, and its images."""

import json
from pathlib import Path

import numpy as np
import pytest

from autopilot.control import loop_design as loop_pictures
from autopilot.control.loop_design import PHASE_MARGIN_MIN, design, step_response
from dronecats.cli.main import main
from vehicles.airframe import load


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reduce the number of harmonics of the step responses to an eighth, to save time."""
    monkeypatch.setattr(loop_pictures, "SAMPLES", loop_pictures.SAMPLES // 8)


@pytest.mark.usefixtures("coarse")
def test_margins_are_printed_and_agree_with_python_control(capsys: pytest.CaptureFixture[str]) -> None:
    """Checks one airframe. tests/autopilot/test_design.py checks all."""
    assert main(["tune", "hexa", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["gains"]["attitude_p"] == pytest.approx(design(load("hexa")).attitude_p, rel=1e-3)
    assert len(result["loops"]) == 10
    for loop in result["loops"].values():
        assert loop["phase_margin_deg"] >= PHASE_MARGIN_MIN
        assert loop["gain_margin_db"] >= 6.0
        assert loop["phase_margin_by_control_deg"] == pytest.approx(loop["phase_margin_deg"], abs=1.0)


@pytest.mark.usefixtures("coarse")
def test_tune_writes_images_and_prints_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", "x500", "--out", str(tmp_path)]) == 0
    assert "horizontal velocity" in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x500-bode.png", "x500-steps.png"]


def test_an_unknown_airframe_is_rejected(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", "x5000"]) == 2
    assert "x500" in capsys.readouterr().err


def test_step_response_matches_a_first_order_loop() -> None:
    time, output = step_response(lambda s: 4.0 / s, 4.0)  # closed loop: 4 / (s + 4)
    late = time > 0.02
    assert output[late] == pytest.approx(1.0 - np.exp(-4.0 * time[late]), abs=5e-3)
