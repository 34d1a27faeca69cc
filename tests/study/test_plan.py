"""A plan is paired: all levels of a pair have the same seed and are flown one after another."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.bench.benchmark_folder import Bench
from dronecats.bench.campaign import Batch, Campaign
from dronecats.bench.matrix import choose_suite
from dronecats.cli.main import main
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.study import design, folder
from dronecats.study.design import Axis, Design
from dronecats.study.plan import plan
from foundation.errors import UsageError
from tests.bench.scripted_engine import MOVED, STUCK, ScriptedEngine

TWO = ["residential-approaching-01", "campus-tracking-01"]
ORACLE = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False), seed=5)
BLIND = FlightSpec(pilot="blind:ring", simulated=Simulated(speed=None, rendered=False), seed=5)
LATENCY = Axis(name="latency", levels=(0.0, 0.5, 2.0))
WIND = Axis(name="wind", levels=(0.0, 6.0))


def planned(axes=(LATENCY,), pilots=(("oracle", ORACLE),), flights=2, episodes=TWO, held=None):
    return plan("mine", pilots, choose_suite(episodes, ()), design.full(axes), held=held or {}, flights=flights)


def fly(out, made, script=lambda sortie, time: MOVED, jobs=1):
    """Fly the remaining flights; return them as RUN/EPISODE in the order of their start."""
    bench = Bench(
        out, choose_suite(TWO, ()), made.entries, retry=False,
        first=lambda: folder.write(out, folder.merge_earlier_runs(out, made)),
    )  # fmt: skip
    engine = ScriptedEngine(script)
    try:
        Campaign(bench.runs, jobs=jobs, retry=False).fly(engine)
    finally:
        bench.close()
    return engine.flown


def pair_of(made, name):
    """Return the pilot and the flight number of a run."""
    entry = next(candidate for candidate in made.entries if candidate.name == name)
    run = next(candidate for candidate in made.study.runs if candidate.name == name)
    return entry.flight.pilot, run.flight_number


@given(st.integers(1, 4), st.integers(1, 3), st.integers(1, 3), st.integers(0, 9))
def test_all_levels_of_a_flight_number_have_the_same_seed(flights, latencies, winds, seed):
    axes = (Axis(name="latency", levels=LATENCY.levels[:latencies]), Axis(name="wind", levels=(0.0, 3.0, 6.0)[:winds]))
    base = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False), seed=seed)
    made = planned(axes, [("oracle", base), ("blind", BLIND)], flights)
    assert len(made.entries) == len(made.study.runs) == 2 * flights * latencies * winds
    seeds: dict[tuple[str | None, int], set[int]] = {}
    for entry, run in zip(made.entries, made.study.runs, strict=True):
        assert entry.name == run.name
        seeds.setdefault((entry.flight.pilot, run.flight_number), set()).add(entry.flight.seed)
    assert all(len(paired) == 1 for paired in seeds.values())
    assert [seeds["oracle", number] for number in range(1, flights + 1)] == [{seed + k} for k in range(flights)]


def test_the_levels_of_a_pair_are_flown_one_after_another(tmp_path):
    made = planned(pilots=[("oracle", ORACLE), ("ring", BLIND)])
    flights = [(*pair_of(made, name.split("/")[0]), name.split("/")[1]) for name in fly(tmp_path / "s", made)]
    assert len(flights) == 3 * 2 * 2 * 2
    groups = [flights[place : place + 3] for place in range(0, len(flights), 3)]
    assert all(len(set(group)) == 1 for group in groups)  # three levels of one pair, then the next
    assert len({group[0] for group in groups}) == len(groups)
    assert [group[0][1] for group in groups] == [1] * 4 + [2] * 4  # all first flights precede the second flights


def test_a_resume_flies_the_remaining_flights_in_the_same_order(tmp_path):
    made = planned(flights=1)

    class KilledError(Exception):
        pass

    begun: list[str] = []

    def script(sortie, time):
        begun.append(f"{sortie.folder.parent.name}/{sortie.folder.name}")
        if len(begun) == 3:
            raise KilledError
        return MOVED

    with pytest.raises(KilledError):
        fly(tmp_path / "s", made, script)
    assert begun[:2] + fly(tmp_path / "s", made) == [f"{e.name}/{episode}" for episode in TWO for e in made.entries]
    assert fly(tmp_path / "s", made) == []


def test_stuck_flights_are_not_flown_again(tmp_path):
    made = planned(flights=1)
    assert len(fly(tmp_path / "s", made, lambda sortie, time: STUCK)) == 6
    assert fly(tmp_path / "s", made) == []


def test_a_rejected_resume_leaves_the_folder_unchanged(tmp_path):
    out = tmp_path / "s"
    fly(out, planned(flights=1))
    before = contents(out)
    other = FlightSpec(pilot="oracle", simulated=ORACLE.simulated, seed=9)
    for changed_plan in (
        planned(pilots=[("oracle", other)], flights=3),
        planned(pilots=[("ring", BLIND), ("oracle", other)]),
    ):
        with pytest.raises(UsageError, match=r"oracle-latency-0-f1 .*seed"):
            fly(out, changed_plan)
        assert contents(out) == before
    assert len(fly(out, planned(pilots=[("oracle", ORACLE), ("ring", BLIND)], flights=1))) == 6


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_resume_that_is_killed_during_its_start_can_be_resumed(tmp_path, monkeypatch):
    class KilledError(BaseException):
        pass

    def killed(run, configuration):
        if "f2" in run.name:
            raise KilledError
        return Batch(run, configuration)

    fly(tmp_path / "s", planned(flights=1))
    monkeypatch.setattr("dronecats.bench.benchmark_folder.Batch", killed)
    with pytest.raises(KilledError):
        fly(tmp_path / "s", planned(flights=2))
    with pytest.raises(KilledError):
        fly(tmp_path / "fresh", planned(flights=2))
    monkeypatch.undo()
    assert len(fly(tmp_path / "s", planned(flights=2))) == 6
    assert len(fly(tmp_path / "fresh", planned(flights=2))) == 12


def test_a_run_name_has_the_pilot_the_levels_and_the_flight_number():
    made = planned((LATENCY, WIND), flights=1)
    assert [run.name for run in made.study.runs][:3] == [
        "oracle-latency-0-wind-0-f1", "oracle-latency-0-wind-6-f1", "oracle-latency-0.5-wind-0-f1",
    ]  # fmt: skip
    assert made.study.runs[1].levels == {"latency": 0.0, "wind": 6.0}
    assert made.study.cells == ("approaching", "tracking")
    waver = planned((Axis(name="jitter_rho", levels=(-0.5, 0.5)),), flights=1, held={"rate": 2.0, "jitter_cv": 1.0})
    assert [run.name for run in waver.study.runs] == ["oracle-jitter-rho-minus-0.5-f1", "oracle-jitter-rho-0.5-f1"]


def test_levels_without_a_distinct_name_are_numbered():
    awkward = Design(description="by hand", points=({"latency_policy": "fixed:1"}, {"latency_policy": "fixed-1"}))
    with pytest.raises(UsageError, match=r"latency_policy .*fixed-1"):  # fixed-1 is no policy; names come first
        plan("mine", [("oracle", ORACLE)], choose_suite(TWO, ()), awkward, held={}, flights=1)
    alike = Design(
        description="by hand", points=({"latency_policy": "lognormal:1,1"}, {"latency_policy": "lognormal:1,1.0"})
    )
    long = Design(
        description="by hand", points=({"latency_policy": f"fixed:{'0' * 100}1"}, {"latency_policy": "fixed:2"})
    )
    for made in (alike, long):
        names = [r.name for r in plan("m", [("o", ORACLE)], choose_suite(TWO, ()), made, held={}, flights=1).study.runs]
        assert names == (["o-point-1-f1", "o-point-2-f1"] if made is long else [
            "o-latency-policy-lognormal-1-1-f1", "o-latency-policy-lognormal-1-1.0-f1"])  # fmt: skip


def test_two_files_with_the_same_latencies_are_rejected_as_two_levels(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "t.csv").write_text("0.5\n")
    axis = Axis(name="latency_policy", levels=(f"trace:{tmp_path}/a/t.csv", f"trace:{tmp_path}/b/t.csv"))
    with pytest.raises(UsageError, match="latency_policy"):
        planned([axis])
    held = planned([WIND], held={"latency_policy": axis.levels[0]})
    assert held.study.held["latency_policy"].startswith("trace:t.csv@")
    assert held.entries[0].flight.latency.trace == (0.5,)


def test_held_levels_apply_to_every_flight_and_are_not_levels_of_a_run():
    made = planned(held={"wind": 3.0}, flights=1)
    assert {entry.flight.disturbances.vehicle.wind_ned for entry in made.entries} == {(3.0, 0.0, 0.0)}
    assert made.study.held == {"wind": 3.0}
    assert all(set(run.levels) == {"latency"} for run in made.study.runs)


def test_a_contradictory_plan_is_rejected():
    for options, parts in (
        ({"held": {"latency": 1.0}}, "^latency .*held"),
        ({"held": {"rate": 1.0}}, "rate .*latency "),
        ({"pilots": ()}, "--model .*--pilot"),
        ({"flights": 4000}, "12,000 .*10,000"),
        ({"held": {"command": "solo"}}, "command .*residential-approaching-01 "),
        ({"pilots": [("oracle", ORACLE), ("oracle", ORACLE)]}, "pilots .*name"),
    ):
        with pytest.raises(UsageError, match=parts):
            planned(**options)


def test_study_json_is_read_back_unchanged(tmp_path):
    made = planned((LATENCY, WIND), held={"gusts": 2.0})
    folder.write(tmp_path / "s", made.study)
    assert folder.read(tmp_path / "s") == made.study
    assert folder.merge_earlier_runs(tmp_path / "s", made) == made.study


def test_a_study_grows_by_flights_and_pilots(tmp_path):
    folder.write(tmp_path, planned(flights=1).study)
    more = folder.merge_earlier_runs(tmp_path, planned(pilots=[("ring", BLIND)], flights=2))
    assert more.flights == 2
    assert {run.name for run in more.runs} == {
        f"{pilot}-latency-{level}-f{number}"
        for pilot, last in (("oracle", 1), ("ring", 2)) for level in ("0", "0.5", "2") for number in range(1, last + 1)
    }  # fmt: skip
    folder.write(tmp_path, more)
    assert folder.merge_earlier_runs(tmp_path, planned(flights=1)).flights == 2


def test_a_pilot_with_a_long_name_renames_no_other_run(tmp_path):
    names = ("frame_delay", "link_delay", "link_jitter", "frame_drop", "frame_stale")
    axes = [Axis(name=name, levels=(0.125, 0.875)) for name in names]
    first = planned(axes, flights=1)
    second = planned(
        axes, pilots=[("oracle", ORACLE), ("a-model-with-a-long-name-instruct-2507-fp8", BLIND)], flights=1
    )
    assert [entry.name for entry in second.entries[:32]] == [entry.name for entry in first.entries]
    assert second.entries[32].name == "a-model-with-a-long-name-instruct-2507-fp8-point-01-f1"
    folder.write(tmp_path, first.study)
    assert len(folder.merge_earlier_runs(tmp_path, second).runs) == 64


def test_the_folder_of_another_study_is_rejected(tmp_path):
    folder.write(tmp_path, planned().study)
    other = plan("mine", [("o", ORACLE)], choose_suite(TWO, ()), design.one_at_a_time([WIND]), held={}, flights=1)
    with pytest.raises(UsageError, match=r"design, .*; factors, latency 0, 0\.5, 2 .*wind 0, 6 .*--out") as no:
        folder.merge_earlier_runs(tmp_path, other)
    assert "\n" not in str(no.value)
    with pytest.raises(UsageError, match=r"cells, .*tracking .*; episodes, .*campus-tracking-01 "):
        folder.merge_earlier_runs(tmp_path, planned(episodes=TWO[:1]))
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "bench.json").write_text("{}")
    with pytest.raises(UsageError, match="--out"):
        folder.merge_earlier_runs(tmp_path / "b", planned())


def test_invalid_levels_are_reported_in_one_line(tmp_path):
    for changes, parts in (
        ({"factors": [{"name": "wind", "unit": "m/s", "levels": []}]}, "wind .*level"),
        ({"factors": [{"name": "wind", "unit": "m/s", "levels": ["low", "high"]}]}, "wind .*0 to 30 .*'low'"),
        ({"factors": [{"name": "wine", "unit": "m/s", "levels": [1]}]}, ".*'wine'"),
        ({"held": {"gusts": "some"}}, "held: gusts .*'some'"),
        ({"runs": [{"name": "a", "levels": {"wind": "much"}, "flight_number": 1}]}, "a: wind .*'much'"),
        ({"runs": [{"name": "a", "levels": {"wind": 3}, "flight_number": 1}]}, "a: wind 3.0 "),
    ):
        folder.write(tmp_path, planned([WIND]).study)
        document = json.loads((tmp_path / "study.json").read_text())
        (tmp_path / "study.json").write_text(json.dumps({**document, **changes}))
        with pytest.raises(UsageError, match=rf"study\.json: {parts}") as no:
            folder.read(tmp_path)
        assert "\n" not in str(no.value), changes
        assert main(["study", "report", str(tmp_path)]) == 2, changes


def test_invalid_study_files_are_reported_in_one_line(tmp_path):
    for text in ("", "[]", "{", '{"schema": 1}', '{"schema": 2, "name": "x"}'):
        (tmp_path / "study.json").write_text(text)
        with pytest.raises(UsageError, match=r"study\.json") as raised:
            folder.read(tmp_path)
        assert "\n" not in str(raised.value), text


def test_a_folder_with_unknown_files_is_rejected(tmp_path):
    """A study.json without a bench.json is accepted: a study that was killed between the two writes resumes."""
    made = planned(flights=1)
    folder.write(tmp_path / "s", made.study)
    assert len(fly(tmp_path / "s", made)) == 6
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes").touch()
    with pytest.raises(UsageError, match=r"other.*bench\.json"):
        fly(tmp_path / "other", made)
    assert not (tmp_path / "other" / "study.json").exists()
