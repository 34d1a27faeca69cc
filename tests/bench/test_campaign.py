"""Order, retries and end of a campaign, with an engine that writes the folders of flights from a script."""

import json
import shutil

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.spec import ModelSpec
from dronecats.bench.benchmark_folder import Bench
from dronecats.bench.campaign import Batch, Campaign, OpenRun
from dronecats.bench.matrix import BenchEntry, choose_suite, entries, part_of
from dronecats.bench.tables import bench_rows
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json
from dronecats.judge.metrics.failure_mode import is_stuck, track_m
from episodes.records import catalogue
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.rows import Pose
from tests.bench.scripted_engine import BROKEN, MOVED, NEAR, REJECTED, SOLVED, SPENT, STUCK, ScriptedEngine

ORACLE = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False))
FOUR = ["residential-approaching-01", "residential-approaching-02", "campus-tracking-01", "campus-tracking-02"]
FLEET = "blocks-commanding-01"
POLICY = (LatencyPolicy.parse("fixed:0.5"),)


def bench(out, episodes=FOUR, flights=1, retry=True, **part):
    suite = choose_suite(episodes, [])
    runs = entries([("oracle", ORACLE)], suite, latencies=POLICY, flights=flights)
    return Bench(out, suite, runs, retry=retry, **part)


def fly(opened, script, jobs=2, retry=True):
    """Fly the remaining flights; return (the engine, the ending, the results)."""
    engine, came = ScriptedEngine(script), []  # type: ignore[var-annotated]
    ending = Campaign(opened.runs, jobs=jobs, retry=retry).fly(engine, came.append)
    assert engine.closed
    return engine, ending, came


def test_every_flight_is_flown_once_and_jobs_limits_those_in_the_air(tmp_path):
    opened = bench(tmp_path / "b", flights=2)
    engine, ending, came = fly(opened, lambda sortie, time: MOVED, jobs=3)
    assert ending == "flown"
    assert engine.most == 3
    runs = [f"oracle-flat-fixed-0.5-f{k}" for k in (1, 2)]
    assert engine.flown == [f"{run}/{episode}" for run in runs for episode in FOUR]
    assert sorted(c.run.entry.flight.seed for c in came) == [0] * 4 + [1] * 4
    opened.close()
    again = bench(tmp_path / "b", flights=2)
    assert not Campaign(again.runs, jobs=1).left
    again.close()


def test_broken_flights_are_repeated_and_failed_ones_are_kept(tmp_path):
    opened = bench(tmp_path / "b")
    fly(opened, lambda sortie, time: BROKEN if sortie.folder.name == FOUR[1] else MOVED)
    opened.close()
    again = bench(tmp_path / "b")
    engine, _, _ = fly(again, lambda sortie, time: SOLVED)
    assert [name.split("/")[1] for name in engine.flown] == [FOUR[1]]
    assert [line.solved for line in bench_rows(again.scores(lambda run, episode: None)) if line.group == "all"] == [1]
    again.close()


def test_flights_that_did_not_move_are_retried_once(tmp_path):
    """The first episode is stuck twice. The second episode moves in its second flight."""
    opened = bench(tmp_path / "b")

    def script(sortie, time):
        return {FOUR[0]: STUCK, FOUR[1]: STUCK if time == 1 else SOLVED}.get(sortie.folder.name, MOVED)

    engine, _, came = fly(opened, script, jobs=1)
    assert [name.split("/")[1] for name in engine.flown] == [FOUR[0], FOUR[0], FOUR[1], FOUR[1], FOUR[2], FOUR[3]]
    assert [each.again for each in came] == [True, False, True, False, False, False]
    run = opened.runs[0].batch.run
    assert {path.name for path in (run / layout.RETRIED).iterdir()} == set(FOUR[:2])
    retries = json.loads((run / "retries.json").read_text())
    assert retries == {name: {"outcome": "failure", "track_m": 0.0} for name in FOUR[:2]}
    scores = {each.episode: each for each in opened.scores(lambda run, episode: None)}
    assert [scores[name].retried for name in FOUR] == [True, True, False, False]
    assert [scores[name].outcome for name in FOUR] == ["failure", "success", "failure", "failure"]
    (line,) = [line for line in bench_rows(list(scores.values())) if line.group == "all"]
    assert (line.flights, line.solved, line.retries) == (4, 1, 2)
    opened.close()
    again = bench(tmp_path / "b")
    assert not Campaign(again.runs, jobs=1).left
    again.close()


def test_without_retry_a_stuck_flight_counts_and_can_be_retried_later(tmp_path):
    opened = bench(tmp_path / "b", retry=False)
    engine, _, _ = fly(opened, lambda sortie, time: STUCK, retry=False)
    assert len(engine.flown) == 4
    assert not opened.runs[0].batch.retried(FOUR[0])
    opened.close()
    later = bench(tmp_path / "b")
    assert len(Campaign(later.runs, jobs=1).left) == 4
    later.close()


def test_an_interrupted_retry_is_flown_again_without_a_second_retry(tmp_path):
    """The run is killed during the retry. The next run flies the retry, and no third flight."""
    opened = bench(tmp_path / "b", FOUR[:1])

    def script(sortie, time):
        if time == 1:
            return STUCK
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fly(opened, script)
    batch = opened.runs[0].batch
    assert batch.retried(FOUR[0])
    assert batch.left(FOUR[:1], retry=True) == FOUR[:1]
    opened.close()
    again = bench(tmp_path / "b", FOUR[:1])
    engine, _, came = fly(again, lambda sortie, time: STUCK)
    assert len(engine.flown) == 1
    assert not came[0].again
    again.close()


def test_no_flight_begins_after_the_budget_is_spent(tmp_path):
    opened = bench(tmp_path / "b")
    engine, ending, came = fly(opened, lambda sortie, time: SPENT if sortie.folder.name == FOUR[1] else STUCK)
    assert ending == "budget"
    assert len(engine.flown) == 2  # the two in the air; no other flight and no retry begins
    assert not [each for each in came if each.again]
    opened.close()
    again = bench(tmp_path / "b")
    assert len(Campaign(again.runs, jobs=1).left) == 4
    again.close()


def test_a_model_rejected_by_its_endpoint_is_dropped_and_the_others_fly(tmp_path):
    models = [ModelSpec(provider="local", name=name, base_url="http://h/v1") for name in ("wrong", "right")]
    runs = [
        OpenRun(
            entry=BenchEntry(
                name=f"{model.name}-{seed}", episodes=tuple(FOUR),
                flight=FlightSpec(model=model, simulated=Simulated(speed=None), seed=seed),
            ),
            batch=Batch(tmp_path / f"{model.name}-{seed}", {"agent": "x"}), part=tuple(FOUR),
        )
        for model in models for seed in (0, 1)
    ]  # fmt: skip
    engine, came = ScriptedEngine(lambda sortie, time: REJECTED if "wrong" in str(sortie.folder) else MOVED), []  # type: ignore[var-annotated]
    assert Campaign(runs, jobs=1).fly(engine, came.append) == "flown"
    assert [each.split("/")[0] for each in engine.flown] == ["wrong-0", *["right-0"] * 4, *["right-1"] * 4]
    assert [each.dropped for each in came] == [7] + [0] * 8


@given(st.lists(st.integers(0, 999), unique=True, max_size=40), st.integers(1, 7), st.none() | st.integers(1, 50))
def test_shards_contain_each_episode_once(numbers, parts, limit):
    episodes = [str(number) for number in numbers]
    shards = [part_of(episodes, limit, (k + 1, parts)) for k in range(parts)]
    assert sorted(name for part in shards for name in part) == sorted(episodes[:limit])
    assert max(map(len, shards)) - min(map(len, shards)) <= 1


def test_merged_shard_folders_form_one_benchmark(tmp_path):
    for k in (1, 2):
        part = bench(tmp_path / str(k), flights=2, shard=(k, 2))
        engine, _, _ = fly(part, lambda sortie, time: MOVED)
        assert len(engine.flown) == 4
        part.close()
    assert (tmp_path / "1" / "bench.json").read_text() == (tmp_path / "2" / "bench.json").read_text()
    for path in (tmp_path / "2").rglob("*"):  # cp -rn 2/. 1/
        there = tmp_path / "1" / path.relative_to(tmp_path / "2")
        if path.is_dir():
            there.mkdir(exist_ok=True)
        elif not there.exists():
            shutil.copy(path, there)
    whole = bench(tmp_path / "1", flights=2)
    assert not Campaign(whole.runs, jobs=1).left
    (line,) = [line for line in bench_rows(whole.scores(lambda run, episode: None)) if line.group == "all"]
    assert line.flights == 8
    whole.close()


def test_the_matrix_combines_every_pilot_latency_and_command():
    latencies = [LatencyPolicy.parse(text) for text in ("fixed:0.5", "rate:2")]
    suite = choose_suite([*FOUR, FLEET], [])
    two = [("oracle", ORACLE), ("vision", FlightSpec(pilot="vision", simulated=Simulated(speed=None), seed=7))]
    runs = entries(two, suite, commands=("flat", "solo"), latencies=latencies, flights=2)
    assert len({run.name for run in runs}) == len(runs) == 2 * 2 * 2 * 2
    assert {run.episodes for run in runs if run.flight.command == "solo"} == {(FLEET,)}
    assert {run.episodes for run in runs if run.flight.command == "flat"} == {(*FOUR, FLEET)}
    by_name = {run.name: run for run in runs}
    first, second = (as_redacted_json(by_name[f"vision-flat-rate-2-f{k}"].flight) for k in (1, 2))
    assert (first.pop("seed"), second.pop("seed")) == (7, 8)
    assert first == second
    alone, led = entries(two[:1], suite, commands=("hierarchical",), latencies=POLICY)
    assert (alone.episodes, alone.flight.command) == (tuple(FOUR), "flat")
    assert (led.episodes, led.flight.command) == ((FLEET,), "hierarchical")
    with pytest.raises(UsageError, match="oracle-flat"):
        entries([two[0], two[0]], suite, latencies=POLICY)
    with pytest.raises(UsageError, match="--pilot"):
        entries([], suite, latencies=POLICY)
    with pytest.raises(UsageError, match=r"--command .*flat, hierarchical, solo"):
        entries(two, suite, commands=("loud",), latencies=POLICY)


def test_a_suite_is_identified_by_its_records():
    quick = choose_suite([], ["quick"])
    assert list(quick.records) == catalogue.suite_ids("quick")
    assert quick.identity.name == "quick"
    assert choose_suite(catalogue.suite_ids("quick")[:3], []).identity.sha256 != quick.identity.sha256
    assert choose_suite([], ["quick", "one-drone"]).identity.name == "quick+one-drone"
    with pytest.raises(UsageError, match="--suite"):
        choose_suite([], [])


def test_a_folder_accepts_other_pilots_but_not_other_episodes_or_settings(tmp_path):
    bench(tmp_path / "b").close()
    suite = choose_suite(FOUR, [])
    blind = FlightSpec(pilot="blind:fan", simulated=Simulated(speed=None, rendered=False))
    joined = Bench(tmp_path / "b", suite, entries([("blind:fan", blind)], suite, latencies=POLICY), retry=True)
    joined.close()
    record = json.loads((tmp_path / "b" / "bench.json").read_text())
    assert [run["name"] for run in record["runs"]] == ["blind-fan-flat-fixed-0.5-f1", "oracle-flat-fixed-0.5-f1"]
    with pytest.raises(UsageError, match="episodes"):
        bench(tmp_path / "b", FOUR[:2])
    lenient = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False), parser="lenient")
    with pytest.raises(UsageError, match=r"\bparser\b"):
        Bench(tmp_path / "b", suite, entries([("oracle", lenient)], suite, latencies=POLICY), retry=True)
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.txt").write_text("three years")
    with pytest.raises(UsageError, match=r"bench\.json"):
        bench(tmp_path / "thesis")


def test_a_run_records_its_suite(tmp_path):
    opened = bench(tmp_path / "b")
    record = json.loads((opened.runs[0].batch.run / "run.json").read_text())
    assert record["suite"]["sha256"] == choose_suite(FOUR, []).identity.sha256
    assert record["suite"]["name"] is None
    assert len(record["code_sha256"]) == 64
    with pytest.raises(UsageError, match=str(opened.runs[0].batch.run)):
        Batch(opened.runs[0].batch.run, {})
    opened.close()


def at(t, north_m, drone=0):
    return Pose(t=t, drone=drone, position_ned=(north_m, 0.0, -2.0), distance_m=1.0, visible=True)


def test_a_hover_is_stuck_and_a_fleet_with_one_moving_drone_is_not():
    hover = [at(t / 2, 0.02 * (t % 2)) for t in range(601)]  # 12 m in total, back and forth
    assert is_stuck(hover)
    assert track_m(hover) == 0.0
    assert is_stuck([*hover, at(300.0, 4.999)])
    assert not is_stuck([*hover, at(300.0, -5.0)])
    fleet = [*hover, at(1.0, 40.0, drone=1), at(300.0, 46.0, drone=1)]
    assert not is_stuck(fleet)
    assert track_m(fleet) == 6.0
    assert not is_stuck([])  # the result is unknown
    assert track_m([]) is None


def test_a_drone_that_flies_back_and_forth_is_not_stuck():
    swing = [at(t / 2, 3.0 * (t % 12 < 6)) for t in range(601)]
    assert track_m(swing) == pytest.approx(3.0 * 100)
    assert not is_stuck(swing)


def test_a_success_without_movement_is_not_retried(tmp_path):
    opened = bench(tmp_path / "b", FOUR[:1])
    engine, _, _ = fly(opened, lambda sortie, time: NEAR)
    assert len(engine.flown) == 1
    opened.close()
