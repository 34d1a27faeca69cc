"""Every benchmark runs and prints its figures. How large they are is the benchmarks' to say, on a quiet machine."""

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
# which the others are made of: no command
PARTS = {"machine", "stand_in", "page_client", "flight_peers", "render_peers", "render_export"}
SPEEDS = {f"{name}_{of}" for name in ("core", "mavlink", "mavlink_onboard", "fleet4") for of in ("rtf", "rtf_x_loop")}
MILLISECONDS = {f"ms_{size}" for size in ("1280x720", "640x360", "agent", "fleet4_agent")}


def printed(module: str, *arguments: str) -> list[dict[str, Any]]:
    """Return the objects that the short form of a benchmark prints, a line each."""
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


def assert_figures(found: dict[str, Any], names: set[str]) -> None:
    """Every name has a number above nothing, and nowhere is one that is none."""
    assert {name for name in names if not found.get(name, 0.0) > 0.0} == set()
    assert all(map(math.isfinite, numbers(found)))


def test_every_benchmark_is_looked_at_here():
    tested = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert {path.stem for path in (ROOT / "benchmarks").glob("[a-z]*.py")} - PARTS <= tested


def test_presses():
    (found,) = printed("presses")
    assert_figures(found["presses"][0], {"hits", "speed", "attitude_deg", "left_m"})
    assert found["of"] == len(found["presses"]) == 2


def test_landings():
    (found,) = printed("landings")
    assert found["of"] == len(found["landings"]) == 1
    assert found["landings"][0]["disarmed"] or found["landings"][0]["texts"]


def test_soak():
    for found, vehicles in zip(printed("soak"), (1, 4), strict=True):
        assert_figures(found, {"hours", "pictures", "files_most", "logs_most", "real_time_factor"})
        assert (found["vehicles"], found["rounds"], found["failed"]) == (vehicles, vehicles, 0)
        assert {"client", "simulator_process", "camera"} <= set(found["processes"])


@needs("browser")
def test_page():
    for embed in ((), ("--embed",)):
        (found,) = printed("page", *embed)
        assert_figures(found, {"shown_ms", "interactive_ms", "flight_ms", "page_mb"})
        assert (found["flights"], found["embedded"]) == (18, bool(embed))


def test_flight(tmp_path):
    (found,) = printed("flight", "--peers", "--peers-dir", str(tmp_path))
    assert_figures(found, SPEEDS)
    assert found["machine"]["python_loop_ms"] > 0.0
    assert {peer["note"].split(":")[0] for peer in found["peers"].values()} == {"skipped"}


def test_agent():
    (found,) = printed("agent")
    own = {
        f"step_ms{drones}{part}" for drones in ("", "_4_drones") for part in ("", "_to_the_model", "_from_the_model")
    }
    assert_figures(found, own)
    assert_figures(found["in_flight"], {"wall_s", "wall_over_model", "cpu_ms_per_step", "rss_mb", "pss_mb"})
    assert found["in_flight"]["flights"] == 2
    assert found["in_flight"]["steps"] >= 2 * found["in_flight"]["flights"]


def test_render(tmp_path):
    (found,) = printed("render", "--peers", "--peers-dir", str(tmp_path))
    assert_figures(found, MILLISECONDS | {"rss_mb"})
    more = {"cpu_ms_1280x720_per_loop", "cpu_ms_agent_per_loop", "ssim_mean"}
    assert_figures(found["maps"]["blocks"], MILLISECONDS | more)
    assert found["machine"]["python_loop_ms"] > 0.0
    assert {peer["note"].split(":")[0] for peer in found["peers"].values()} == {"absent"}


def test_steps(tmp_path):
    table = tmp_path / "page.md"
    table.write_text("before\n<!-- steps begin -->\n<!-- steps end -->\nafter\n", encoding="utf-8")
    (found,) = printed("steps", "--airframe", "x500", "--table", str(table), "--plots", str(tmp_path))
    (rows,) = found["airframes"].values()
    for name, row in rows.items():
        assert_figures(row, {"drift_m", "drift_vertical_m"} if name == "hover" else {"rise_s"})
    assert "| x500 |" in table.read_text(encoding="utf-8")
    assert (tmp_path / "steps.png").stat().st_size > 0


def test_bench():
    (found,) = printed("bench")
    assert_figures(found, {"episodes_per_hour", "cpu_s_per_episode", "again_s"})
    assert found["episodes"] == found["solved"] == 2


def test_garbage():
    quiet, flooded = printed("garbage")
    for row in (quiet, flooded):
        assert_figures(row, {"lag_ms", "answered_share", "answer_ms"})
    assert flooded["datagrams"] > 100


def test_bad_wire():
    perfect, lossy = printed("bad_wire")
    for flown in (perfect, lossy):
        assert flown["survived"], flown["why"]
        assert_figures(flown, set())
        assert {"astray_m", "end_m", "heading_off_deg"} <= flown.keys()
    assert "lost" not in perfect["up"]
    assert "lost" in lossy["up"]


def test_commanding():
    found = {flight["command"]: flight for flight in printed("commanding")}
    assert found.keys() == {"flat", "solo", "hierarchical"}
    for flight in found.values():
        assert_figures(flight, {"steps", "seconds", "questions"})
    assert_figures(found["hierarchical"], {"commanded", "commanded_tokens"})


def test_reading():
    (found,) = printed("reading")
    assert {row["kind"] for row in found["rows"]} == {"sign", "plate"}
    assert all(row["package"] == row["pictures"] == 1 for row in found["rows"])
    assert found["cpu_ms_per_line"] > 0.0


def test_judge():
    (found,) = printed("judge")
    assert_figures(found, {"judge_s", "cpu_ms_per_episode", "cpu_ms_per_episode_per_loop", "megabytes"})
    assert (found["episodes"], found["doubtful"]) == (10, 0)


def test_study():
    (found,) = printed("study", "--suite", "quick")
    assert_figures(found, {"minutes_for_2000", "two_jobs_over_one"})
    for figures in (*found["undrawn"].values(), found["drawn"]):
        assert_figures(figures, {"episodes_per_core_hour", "episodes_per_hour", "cpu_s_per_episode"})
    for share in (found["parts"], found["phases"]):
        assert sum(share.values()) == pytest.approx(1.0, abs=0.01)
    assert {"episode", "landing", "ascent to the start pose"} <= set(found["phases"])
    assert "physics, estimator and inner loops (compiled)" in found["parts"]


def test_film():
    (found,) = printed("film")
    assert_figures(found, {"wall_s", "cpu_s", "shared_out_s", "cpu_ms_per_picture", "megabytes"})
    assert (found["pictures"], found["read_back"], found["film_s"]) == (10, 10, 1.0)


def test_view():
    (found,) = printed("view")
    assert found["matched"] > 10
    assert 0.0 <= found["late_ms_median"] < 1000.0
    assert found["updates_hz"] > 1.0
    assert found["viewer_core"] > 0.0
    assert found["flush_ratio"] > 0.0
