"""Judging many episodes: results do not depend on the number of processes, and users can add metrics."""

import json
import re

import pytest

from benchmarks.judge import write_episode
from dronecats.cli.main import main
from dronecats.judge.episode import verdict_of
from dronecats.judge.metrics.judging import METRICS, Judging, judged_episodes
from foundation.run_folder.writing import as_json
from tests.support.refusal import refusal

OWN = '''
from dronecats.judge.metrics.metric import Metric

def last_yaw(flown):
    """Return the last heading (°)."""
    return flown.logs.poses[-1].yaw_deg

METRICS = (
    Metric(name="last_yaw_deg", title="Last yaw", unit="°", level="episode", better=None,
           definition="heading at the last pose", paper="", of=last_yaw),
)
'''


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return a folder with two runs. One of them contains a fleet episode."""
    out = tmp_path_factory.mktemp("judging")
    for number in range(6):
        write_episode(out / ("one" if number < 4 else "two") / f"e-{number}", number)
    for run in ("one", "two"):
        (out / run / "run.json").write_text("{}")
    return out


def summaries(episodes):
    return [(episode.folder, as_json(episode.verdict), episode.mode, dict(episode.values)) for episode in episodes]


def test_results_and_order_do_not_depend_on_the_number_of_processes(runs):
    folders = sorted(runs.glob("*/e-*"), reverse=True)
    judging = Judging(measured=True)
    alone = summaries(judged_episodes(folders, judging, processes=1))
    assert [folder for folder, *_ in alone] == folders
    assert summaries(judged_episodes(folders, judging, processes=2)) == alone
    for folder, verdict, _, values in alone:
        assert verdict == as_json(verdict_of(folder))
        assert list(values) == list(METRICS)


def test_the_command_judges_several_runs_and_reports_verdicts_that_differ(runs, tmp_path, capsys):
    assert main(["judge", str(runs), "--json"]) == 0
    episodes = json.loads(capsys.readouterr().out)["episodes"]
    assert list(episodes) == ["one/e-0", "one/e-1", "one/e-2", "one/e-3", "two/e-4", "two/e-5"]
    assert all(episode["stored_agrees"] and set(episode["metrics"]) == set(METRICS) for episode in episodes.values())
    assert main(["judge", str(runs / "one"), str(runs / "two" / "e-4"), "--cap", "100"]) == 0
    assert re.findall(r"\d+", capsys.readouterr().out.splitlines()[-1]) == ["5", "0"]
    write_episode(tmp_path / "r" / "e-1", 1)
    verdict = tmp_path / "r" / "e-1" / "verdict.json"
    verdict.write_text(verdict.read_text().replace('"steps": 115', '"steps": 114'))
    assert main(["judge", str(runs / "one"), str(tmp_path / "r")]) == 4
    assert "in steps" in capsys.readouterr().out


def test_a_damaged_episode_does_not_affect_others(runs, tmp_path):
    write_episode(tmp_path / "r" / "e-1", 1)
    write_episode(tmp_path / "r" / "e-2", 2)
    (tmp_path / "r" / "e-1" / "truth.jsonl").write_text("[]\n{}\n")
    damaged, intact = judged_episodes([tmp_path / "r" / "e-1", tmp_path / "r" / "e-2"], Judging(measured=True))
    assert "line 1" in (damaged.verdict.error or "")
    assert (damaged.mode, damaged.values) == (None, {})
    assert intact.verdict.outcome == "failure"


def test_a_custom_metric_is_computed_and_printed(runs, tmp_path, capsys):
    (tmp_path / "own.py").write_text(OWN)
    assert main(["judge", str(runs / "one" / "e-1"), "--metric", str(tmp_path / "own.py"), "--json"]) == 0
    values = json.loads(capsys.readouterr().out)["episodes"]["e-1"]["metrics"]
    truth = (runs / "one" / "e-1" / "truth.jsonl").read_text().splitlines()
    poses = [row for row in map(json.loads, truth) if row["kind"] == "pose"]
    assert values["last_yaw_deg"] == pytest.approx(poses[-1]["yaw_deg"])
    assert main(["judge", str(runs), "--metric", str(tmp_path / "own.py")]) == 0
    assert f"{values['last_yaw_deg']:g}" in capsys.readouterr().out


def test_invalid_custom_metrics_are_rejected(runs, tmp_path, capsys):
    cases = [
        (("METRICS", "MEASURES"), "METRICS"),
        (("import Metric", "import Metrik"), "ImportError"),
        (("def last_yaw", "def"), "SyntaxError"),
        (("[-1].yaw_deg", "[-1].roll_deg"), "last_yaw_deg of e-1"),
        (("[-1].yaw_deg", "[-1]"), "number"),
        (("[-1].yaw_deg", "[-1].yaw_deg * 1e999"), "number"),
        (('level="episode"', 'level="step"'), "decision"),
        (('level="episode"', 'level="run"'), "level"),
        (('"last_yaw_deg"', '"ne_m"'), "ne_m"),
        (('"last_yaw_deg"', '"last yaw"'), "'last yaw'"),
        (('unit="°"', 'unit=""'), "unit"),
        (("of=last_yaw", "of=3"), "`of`"),
        (("METRICS = (", "METRICS = 2 * ("), "two metrics"),
    ]  # fmt: skip
    for number, (change, word) in enumerate(cases):
        assert change[0] in OWN, change
        file = tmp_path / f"own_{number}.py"
        file.write_text(OWN.replace(*change))
        assert main(["judge", str(runs / "one" / "e-1"), "--metric", str(file)]) == 2, change
        assert word in capsys.readouterr().err, change


def test_invalid_files_caps_and_radii_are_rejected(tmp_path):
    for judging, word in (
        (Judging(own=(tmp_path / "none.py",)), "none.py"),
        (Judging(cap_s=0.0), "--cap"),
        (Judging(cap_s=float("nan")), "--cap"),
        (Judging(delta_m=-1.0), "--delta"),
    ):
        assert word in refusal(next, judged_episodes([], judging)), judging
