"""Every benchmark runs and prints its figures. Only benchmarks on a quiet machine judge the values."""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.needs import needs

pytestmark = pytest.mark.slow("whole benchmark commands")
ROOT = Path(__file__).parents[2]
# modules that the benchmarks share, not commands
PARTS = {"machine", "stand_in", "page_client", "flight_peers", "render_peers"}
SPEEDS = {f"{name}_{of}" for name in ("core", "mavlink", "mavlink_onboard", "fleet4") for of in ("rtf", "rtf_x_loop")}
MILLISECONDS = {f"ms_{size}" for size in ("1280x720", "640x360", "agent", "fleet4_agent")}


def printed(module: str, *arguments: str) -> list[dict[str, Any]]:
    """Return the objects that the short form of a benchmark prints, one per line."""
    command = [sys.executable, "-m", f"benchmarks.{module}", "--short", "--json", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def numbers(value: object) -> list[float]:
    """Return every number that a JSON value holds, at any depth."""
    if isinstance(value, dict):
        return [n for held in value.values() for n in numbers(held)]
    if isinstance(value, list):
        return [n for held in value for n in numbers(held)]
    return [value] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def assert_figures(output: dict[str, Any], names: set[str]) -> None:
    """Assert that every name has a positive number, and that all numbers are finite."""
    assert {name for name in names if not output.get(name, 0.0) > 0.0} == set()
    assert all(map(math.isfinite, numbers(output)))


def test_every_benchmark_has_a_test_here():
    tested = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert {path.stem for path in (ROOT / "benchmarks").glob("[a-z]*.py")} - PARTS <= tested


def test_presses():
    (output,) = printed("presses")
    assert_figures(output["presses"][0], {"hits", "speed", "attitude_deg", "left_m"})
    assert output["of"] == len(output["presses"]) == 2


def test_landings():
    (output,) = printed("landings")
    assert output["of"] == len(output["landings"]) == 1
    assert output["landings"][0]["disarmed"] or output["landings"][0]["texts"]


def test_soak():
    # at ten times the wall clock, a second of a busy machine is the 10 s after which an armed vehicle disarms
    for output, vehicles in zip(printed("soak", "--speed", "4"), (1, 4), strict=True):
        assert_figures(output, {"hours", "pictures", "files_most", "logs_most", "real_time_factor"})
        assert (output["vehicles"], output["rounds"], output["refused"]) == (vehicles, vehicles, {})
        assert output["failed"] == 0
        assert {"client", "simulator_process", "camera"} <= set(output["processes"])


@needs("browser")
def test_page():
    for embed in ((), ("--embed",)):
        (output,) = printed("page", *embed)
        assert_figures(output, {"shown_ms", "interactive_ms", "flight_ms", "page_mb"})
        assert (output["flights"], output["embedded"]) == (18, bool(embed))


def test_flight(tmp_path):
    (output,) = printed("flight", "--peers", "--peers-dir", str(tmp_path))
    assert_figures(output, SPEEDS)
    assert output["machine"]["python_loop_ms"] > 0.0
    assert {peer["note"].split(":")[0] for peer in output["peers"].values()} == {"skipped"}


def test_agent():
    (output,) = printed("agent")
    own = {
        f"step_ms{drones}{part}" for drones in ("", "_4_drones") for part in ("", "_to_the_model", "_from_the_model")
    }
    assert_figures(output, own)
    assert_figures(output["in_flight"], {"wall_s", "wall_over_model", "cpu_ms_per_step", "rss_mb", "pss_mb"})
    assert output["in_flight"]["flights"] == 2
    assert output["in_flight"]["steps"] >= 2 * output["in_flight"]["flights"]


def test_render(tmp_path):
    (output,) = printed("render", "--peers", "--peers-dir", str(tmp_path))
    assert_figures(output, MILLISECONDS | {"rss_mb"})
    more = {"cpu_ms_1280x720_per_loop", "cpu_ms_agent_per_loop", "ssim_mean"}
    assert_figures(output["maps"]["blocks"], MILLISECONDS | more)
    assert output["machine"]["python_loop_ms"] > 0.0
    assert {peer["note"].split(":")[0] for peer in output["peers"].values()} == {"absent"}


def test_steps(tmp_path):
    table = tmp_path / "page.md"
    table.write_text("before\n<!-- steps begin -->\n<!-- steps end -->\nafter\n", encoding="utf-8")
    (output,) = printed("steps", "--airframe", "x500", "--table", str(table), "--plots", str(tmp_path))
    (rows,) = output["airframes"].values()
    for name, row in rows.items():
        assert_figures(row, {"hold_error_m", "drift_m", "drift_vertical_m"} if name == "hover" else {"rise_s"})
    assert "| x500 |" in table.read_text(encoding="utf-8")
    assert (tmp_path / "steps.png").stat().st_size > 0


def test_bench():
    (output,) = printed("bench")
    assert_figures(output, {"episodes_per_hour", "cpu_s_per_episode", "again_s"})
    assert output["episodes"] == output["solved"] == 2


def test_garbage():
    quiet, flooded = printed("garbage")
    for row in (quiet, flooded):
        assert_figures(row, {"lag_ms", "answered_share", "answer_ms"})
    assert flooded["datagrams"] > 100


def test_bad_wire():
    perfect, lossy = printed("bad_wire")
    for flight in (perfect, lossy):
        assert flight["survived"], flight["why"]
        assert_figures(flight, set())
        assert {"astray_m", "end_m", "heading_off_deg"} <= flight.keys()
    assert "lost" not in perfect["up"]
    assert "lost" in lossy["up"]


def test_commanding():
    output = {flight["command"]: flight for flight in printed("commanding")}
    assert output.keys() == {"flat", "solo", "hierarchical"}
    for flight in output.values():
        assert_figures(flight, {"steps", "seconds", "questions"})
    assert_figures(output["hierarchical"], {"commanded", "commanded_tokens"})


def test_reading():
    (output,) = printed("reading")
    assert {row["kind"] for row in output["rows"]} == {"sign", "plate"}
    assert all(row["package"] == row["pictures"] == 1 for row in output["rows"])
    assert output["cpu_ms_per_line"] > 0.0


def test_judge():
    (output,) = printed("judge")
    assert_figures(output, {"judge_s", "cpu_ms_per_episode", "cpu_ms_per_episode_per_loop", "megabytes"})
    assert (output["episodes"], output["doubtful"]) == (10, 0)


def test_study():
    (output,) = printed("study", "--suite", "quick")
    assert_figures(output, {"minutes_for_2000", "two_jobs_over_one"})
    for figures in (*output["undrawn"].values(), output["drawn"]):
        assert_figures(figures, {"episodes_per_core_hour", "episodes_per_hour", "cpu_s_per_episode"})
    for share in (output["parts"], output["phases"]):
        assert sum(share.values()) == pytest.approx(1.0, abs=0.01)
    assert {"episode", "landing", "ascent to the start pose"} <= set(output["phases"])
    assert "physics, estimator and inner loops (compiled)" in output["parts"]


def test_film():
    (output,) = printed("film")
    assert_figures(output, {"wall_s", "cpu_s", "shared_out_s", "cpu_ms_per_picture", "megabytes"})
    assert (output["pictures"], output["read_back"], output["film_s"]) == (10, 10, 1.0)


def test_view():
    (output,) = printed("view")
    assert output["matched"] > 10
    assert 0.0 <= output["late_ms_median"] < 1000.0
    assert output["updates_hz"] > 1.0
    assert output["viewer_core"] > 0.0
    assert output["flush_ratio"] > 0.0
