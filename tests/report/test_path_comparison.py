"""Path comparison: flights with known distances, and flights of our own simulator."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from dronecats.cli.main import main
from dronecats.report.path_comparison import compare, figures
from foundation.errors import UsageError
from foundation.run_folder.reading import episode_folder, read


def flight(
    folder: Path, place, *, seconds=120.0, yaw_deg=0.0, start=(0.0, 0.0, 0.0), drones=1, replies=("x",), decided=float
):
    """Write the logs of a flight and return its folder. `place(t)` is (ahead, right, down) of the start, in m."""
    folder.mkdir(parents=True)
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    rows = [{"kind": "begin", "t": 0.0, "t0_us": 0}]
    for k in range(int(seconds * 2) + 1):
        ahead, right, down = place(k / 2)
        position = [start[0] + c * ahead - s * right, start[1] + s * ahead + c * right, start[2] + down]
        rows += [
            {"kind": "pose", "t": k / 2, "drone": drone, "position_ned": position, "yaw_deg": yaw_deg,
             "target_ned": None, "distance_m": None, "visible": None}
            for drone in range(drones)
        ]  # fmt: skip
    (folder / "truth.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    decisions = [
        {
            "step": n,
            "drone": 0,
            "frame_id": n,
            "t_frame": decided(n),
            "t_decided": decided(n),
            "reply": reply,
            "action": None,
        }
        for n, reply in enumerate(replies)
    ]
    (folder / "decisions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in decisions))
    return folder


def straight(t: float) -> tuple[float, float, float]:
    return (1.0 * t, 0.0, 0.0)


def compared(a: Path, b: Path, seconds: float = 60.0, *, by_step: bool = False, **options):
    return compare(read(episode_folder(a)), read(episode_folder(b)), seconds, by_step=by_step, **options)


def test_paths_that_differ_only_in_start_and_heading_are_equal(tmp_path: Path) -> None:
    a = flight(tmp_path / "a", lambda t: (t, math.sin(t / 9), -0.1 * t))
    b = flight(tmp_path / "b", lambda t: (t, math.sin(t / 9), -0.1 * t), yaw_deg=117.0, start=(400.0, -90.0, -12.0))
    (only,) = compared(a, b)
    assert only.first.max_m < 1e-6
    assert compared(a, b, keep_north=True)[0].first.max_m > 50.0


def test_the_distances_between_diverging_paths_are_correct(tmp_path: Path) -> None:
    a = flight(tmp_path / "a", straight)
    b = flight(tmp_path / "b", lambda t: (t, 0.01 * t, 0.0))
    (only,) = compared(a, b)
    assert only.first.max_m == pytest.approx(0.6, abs=1e-3)
    assert only.first.mean_m == pytest.approx(0.3, abs=1e-3)
    assert only.first.rms_m == pytest.approx(0.6 / math.sqrt(3.0), abs=2e-3)
    assert [span.max_m for span in only.spans] == pytest.approx([0.6, 1.2], abs=1e-3)
    assert only.distance_m[-1] == pytest.approx(1.2, abs=1e-3)


def test_a_delay_along_the_same_path_is_no_lateral_distance(tmp_path: Path) -> None:
    a = flight(tmp_path / "a", straight)
    b = flight(tmp_path / "b", lambda t: straight(max(0.0, t - 0.5)))
    (only,) = compared(a, b)
    assert only.first.max_m == pytest.approx(0.5, abs=1e-3)
    assert only.beside_m < 0.06


def test_alignment_by_step_ignores_slower_replies(tmp_path: Path) -> None:
    """Both move 1 m in the first second of each step. Then they hold, one for 1 s and the other for 1.5 s."""

    def stepped(length_s: float):
        return lambda t: (t // length_s + min(1.0, t % length_s), 0.0, 0.0)

    a, b = (
        flight(tmp_path / name, stepped(length_s), replies=["go"] * 40, decided=lambda n, s=length_s: n * s)
        for name, length_s in (("a", 2.0), ("b", 2.5))
    )
    assert compared(a, b)[0].first.max_m > 5.0
    (only,) = compared(a, b, by_step=True)
    assert only.first.max_m < 0.01
    assert only.first.to_s == pytest.approx(60.0)
    assert main(["compare", str(a), str(b)]) == 0
    assert main(["compare", str(a), str(b), "--align", "time"]) == 1


def test_steps_of_any_length_take_as_long_as_they_last(tmp_path: Path) -> None:
    a, b = (
        flight(tmp_path / name, straight, seconds=seconds, replies=["go"] * 200, decided=lambda n, s=length_s: n * s)
        for name, length_s, seconds in (("a", 0.13, 30.0), ("b", 0.25, 60.0))
    )
    (only,) = compared(a, b, by_step=True)
    assert only.t[-1] == pytest.approx(30.0)  # each step as long as in a, which is faster
    assert only.here[:, 0] == pytest.approx(only.t)
    at = only.t < 20.0
    steps_before = only.t[at] // 0.13
    assert only.there[at, 0] == pytest.approx(only.t[at] + 0.12 * steps_before, abs=0.121)


def test_every_drone_of_a_fleet_is_compared(tmp_path: Path) -> None:
    a, b = (flight(tmp_path / name, straight, drones=3) for name in "ab")
    assert [c.drone for c in compared(a, b)] == [0, 1, 2]


def test_a_flight_shorter_than_the_requested_time_does_not_agree(tmp_path: Path) -> None:
    a, short = flight(tmp_path / "a", straight), flight(tmp_path / "b", straight, seconds=30.0)
    result = figures(compared(a, short), within_m=1.0, seconds=60.0)
    assert not result["agree"]
    assert result["compared_s"] == pytest.approx(30.0)
    assert figures(compared(a, short, 30.0), within_m=1.0, seconds=30.0)["agree"]


def test_the_command_reports_agreement_and_draws_a_plot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a = flight(tmp_path / "a" / "episode", straight, replies=("go", "go", "think"))
    b = flight(tmp_path / "b" / "episode", lambda t: (t, 0.02 * t, 0.0), replies=("go", "rotate", "think"))
    picture = tmp_path / "paths.png"
    assert main(["compare", str(a.parent), str(b), "--plot", str(picture)]) == 1
    assert "1.20 m" in capsys.readouterr().out
    assert picture.stat().st_size > 20_000
    assert main(["compare", str(a), str(b), "--within", "1.3", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["agree"], result["same_replies"], result["steps"]) == (True, 2, 3)


def test_incomparable_paths_are_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a = flight(tmp_path / "a" / "one", straight)
    flight(tmp_path / "a" / "two", straight)
    empty = flight(tmp_path / "c", straight, seconds=0.0)
    with pytest.raises(UsageError, match=f"{tmp_path}/a"):
        episode_folder(tmp_path / "a")
    with pytest.raises(UsageError, match=r"drone 1 .*1 "):
        compared(a, empty)
    assert main(["compare", str(a), str(tmp_path)]) == 2
    assert main(["compare", str(a), str(a), "--within", "nan"]) == 2
    assert main(["compare", str(a), str(a), "--plot", str(tmp_path / "no" / "folder.png")]) == 2
    assert "no/folder.png" in capsys.readouterr().err


@pytest.mark.slow
def test_replayed_decisions_with_another_seed_follow_the_same_path(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The other seed changes the errors of every sensor."""

    def fly(pilot: str, seed: str, out: Path) -> dict[str, Any]:
        arguments = ["fly", "--sitl", "--speed", "max", "--latency", "fixed:0.5", "--json"]
        assert main([*arguments, "--pilot", pilot, "--seed", seed, "--out", str(out)]) == 0
        result_line: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
        return result_line

    first = fly("oracle", "3", tmp_path / "a")  # the oracle has no contacts; after a contact the paths would differ
    decisions = Path(first["run_dir"]) / "decisions.jsonl"
    fly(f"recorded:{decisions}", "4", tmp_path / "b")
    seconds = str(math.floor(first["sim_seconds"]) - 2)
    assert main(["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--seconds", seconds, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["same_replies"] == result["steps"] >= 5
    assert 0.001 < result["drones"][0]["first"]["max_m"] < 1.0
