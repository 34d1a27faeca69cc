"""Loading of a study folder. A folder whose runs differ in more than their levels is rejected."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from dronecats.agent.latency import trace_name
from dronecats.report.report_data import Setting
from dronecats.report.results.collection import parse_exclusion
from dronecats.study import design
from dronecats.study.analysis.loading import _label, load_results
from foundation.errors import UsageError
from tests.report.results.synthetic_runs import reset, tell_incidents
from tests.study.studies import APPROACHING, TRACKING, change_flight, change_run, falling, write_study

LEVELS = {"latency": (0.0, 0.5, 1.0)}
EPISODES = (*TRACKING[:2], *APPROACHING[:1])


@pytest.fixture(scope="module")
def study_folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("study") / "s"
    write_study(out, LEVELS, falling(), pilots=("vision", "oracle"), episodes=EPISODES, flights=2)
    return out


@pytest.fixture
def changed(study_folder, tmp_path):
    """Return a copy of the study folder that a test may change."""
    return shutil.copytree(study_folder, tmp_path / "s")


def test_every_flight_has_its_levels_and_its_pair(study_folder):
    studied = load_results(study_folder)
    assert len(studied.flights) == studied.planned == 2 * 3 * 2 * 3
    assert studied.cells == ("approaching", "tracking")
    assert set(studied.entrants) == {"oracle", "vision"}
    assert studied.notes == ()
    for flight in studied.flights:
        [level] = flight.levels
        assert flight.scored.run.flight["latency"] == f"fixed:{level:g}"
        assert flight.scored.run.folder.name.startswith(f"{flight.entrant}-latency-{level:g}-f{flight.number}")
    pairs = {(flight.entrant, flight.pair) for flight in studied.flights}
    assert len(pairs) * 3 == len(studied.flights)


def test_a_damaged_log_adds_no_cell_to_the_study(changed):
    log = changed / "vision-latency-1-f2" / TRACKING[0] / "truth.jsonl"
    log.write_text("{}\n" + log.read_text())
    assert load_results(changed).cells == ("approaching", "tracking")


@pytest.mark.parametrize(
    ("fields", "parts"),
    [({"code_sha256": "b" * 64}, "code.*b{8}"), ({"prompt_sha256": "d" * 64}, "prompt.*d{8}"),
     ({"protocol": {"RADIUS_M": 6.0, "CAP_S": 300.0}}, "RADIUS_M.*6.0")],
)  # fmt: skip
def test_runs_that_differ_in_more_than_the_factor_are_rejected(changed, fields, parts):
    change_run(changed / "vision-latency-1-f2", **fields)
    with pytest.raises(UsageError, match=f"vision-latency-1-f2.*{parts}"):
        load_results(changed)


def test_flights_with_other_options_are_rejected(changed):
    change_flight(changed / "vision-latency-0.5-f1", parser="lenient")
    with pytest.raises(UsageError, match=r"vision-latency-0.5-f1.*parser.*strict.*lenient"):
        load_results(changed)


def test_a_flight_at_a_level_other_than_its_declared_one_is_rejected(changed):
    change_flight(changed / "vision-latency-0.5-f1", latency="fixed:0.6")
    with pytest.raises(UsageError, match=r"vision-latency-0\.5-f1.*study\.json.*latency 0\.5"):
        load_results(changed)


def test_pairs_with_different_seeds_are_rejected(changed):
    change_flight(changed / "oracle-latency-1-f2", seed=7)
    with pytest.raises(UsageError, match=r"oracle-latency-1-f2.*seeds.*7"):
        load_results(changed)


def test_a_flight_under_two_names_is_rejected(changed):
    document = json.loads((changed / "study.json").read_text())
    [run] = [entry for entry in document["runs"] if entry["name"] == "vision-latency-1-f2"]
    (changed / "study.json").write_text(
        json.dumps({**document, "runs": [*document["runs"], {**run, "name": "vision-point-3-f2"}]})
    )
    shutil.copytree(changed / "vision-latency-1-f2", changed / "vision-point-3-f2")
    with pytest.raises(UsageError, match=r"vision-latency-1-f2.*vision-point-3-f2.*study\.json"):
        load_results(changed)


def test_entrants_with_different_code_are_reported(changed):
    for run in changed.glob("oracle-*"):
        change_run(run, code_sha256="b" * 64)
    [note] = load_results(changed).notes
    assert re.search("oracle.*vision.*code", note)


def test_missing_flights_are_counted(changed):
    shutil.rmtree(changed / "vision-latency-1-f2")
    studied = load_results(changed)
    assert studied.planned - len(studied.flights) == 3


def test_a_folder_without_study_json_is_rejected(tmp_path):
    with pytest.raises(UsageError, match=r"study\.json"):
        load_results(tmp_path)


def test_the_reference_rate_is_the_highest_and_each_agent_is_an_entrant(tmp_path):
    write_study(tmp_path, {"rate": (0.5, 1.0, 2.0), "agent": ("paper", "steady")}, lambda pilot, levels: 1.0,
                episodes=TRACKING[:1])  # fmt: skip
    studied = load_results(tmp_path)
    assert [(factor.name, factor.reference) for factor in studied.factors] == [("rate", 2.0)]
    assert studied.entrants == ("vision · paper", "vision · steady")
    [note] = studied.notes
    assert "Agents of this study: paper, steady." in note


@pytest.mark.parametrize(
    ("name", "levels", "easiest"),
    [
        ("rate_cap", (0.5, 2.0), 2.0),
        ("frame_rate", (1.0, 5.0), 5.0),
        ("setpoint_rate", (5.0, 20.0), 20.0),
        ("link_baud", (57600, 921600), 921600.0),
        ("wind", (0.0, 8.0), 0.0),
    ],
)
def test_the_reference_is_the_easiest_level(tmp_path, name, levels, easiest):
    write_study(tmp_path, {name: levels}, lambda pilot, levels: 1.0, episodes=TRACKING[:1])
    assert [factor.reference for factor in load_results(tmp_path).factors] == [easiest]


@pytest.mark.parametrize(
    ("axes", "held"),
    [
        ({"rate_cap": (0.5, 2.0)}, None),
        ({"reply_stall_share": (0.0, 0.5), "reply_stall_length": (1.0, 3.0)}, None),
        ({"wind_towards": (0.0, 30.0, 45.0)}, {"wind": 6.0}),
    ],
)
def test_refining_factors_are_read_back(tmp_path, axes, held):
    write_study(tmp_path, axes, lambda pilot, levels: 1.0, episodes=TRACKING[:1], held=held)
    studied = load_results(tmp_path)
    assert [factor.levels for factor in studied.factors] == list(axes.values())
    assert len(studied.flights) == studied.planned
    assert studied.entrants == ("vision",)


def test_recorded_latencies_are_stored_with_the_flights(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    Path("fast.csv").write_text("0.5\n0.25\n")
    Path("slow.csv").write_text("2\n3\n")
    policies = ("trace:fast.csv", "stall:0.1,2+trace:slow.csv", "fixed:1")
    write_study(Path("s"), {"latency_policy": policies}, lambda pilot, levels: 1.0, episodes=TRACKING[:1])
    Path("s").rename(tmp_path / "s")
    monkeypatch.chdir(tmp_path)
    shutil.rmtree("here")
    studied = load_results(tmp_path / "s")
    assert studied.factors[0].levels == (
        f"trace:fast.csv@{trace_name((0.5, 0.25))}", f"stall:0.1,2+trace:slow.csv@{trace_name((2.0, 3.0))}", "fixed:1",
    )  # fmt: skip
    assert len(studied.flights) == 3
    slow = next((tmp_path / "s").glob("*slow.csv*"))
    change_flight(slow, latency=f"stall:0.1,2+trace:{trace_name((2.0,))}", latency_trace=[2.0])
    with pytest.raises(UsageError, match=r"slow.csv@"):  # a trace of other latencies does not match
        load_results(tmp_path / "s")


def test_one_factor_at_a_time_keeps_the_other_at_its_base(tmp_path):
    from dronecats.study.analysis.steps import served_rates, target_motions
    from dronecats.study.analysis.study_results import level_results

    write_study(tmp_path, {"latency": (0.0, 1.0), "wind": (0.0, 5.0, 8.0)}, lambda pilot, levels: 1.0,
                episodes=TRACKING[:2], made=design.one_at_a_time)  # fmt: skip
    studied = load_results(tmp_path)
    assert [(row.step.title, row.success.trials) for row in level_results(studied, 0)] == [("0 s", 2), ("1 s", 2)]
    assert [row.success.trials for row in level_results(studied, 1)] == [2, 2, 2]
    latencies = [[flight.scored.steps["latency_s"] for flight in studied.of("vision") if flight.levels == (s, 0.0)]
             for s in (0.0, 1.0)]  # fmt: skip
    decisions = [sum(len(steps) for steps in flights) for flights in latencies]
    assert [row.latency_s.steps for row in served_rates(studied, 0)] == decisions
    assert [row.width_m.steps for row in target_motions(studied, 0)] == decisions


def test_held_factors_must_match_those_of_the_flights(tmp_path):
    write_study(tmp_path, {"latency": (0.0, 1.0)}, falling(), episodes=TRACKING[:1], held={"wind": 3.0})
    assert len(load_results(tmp_path).flights) == 2
    document = json.loads((tmp_path / "study.json").read_text())
    (tmp_path / "study.json").write_text(json.dumps({**document, "held": {"wind": 4.0}}))
    with pytest.raises(UsageError, match=r"study\.json.*wind 4"):
        load_results(tmp_path)


def test_flights_with_many_resets_are_excluded_on_request_and_noted(changed):
    for run in sorted(changed.glob("vision-latency-*")):
        for episode in run.glob("*-*"):
            tell_incidents(episode, *[reset(3.0, 3)] * (run.name == "vision-latency-1-f1"))
    every = load_results(changed)
    assert every.scored == every.flights
    chosen = load_results(changed, exclusions=[parse_exclusion("estimator_resets=2")])
    excluded = [flight for flight in chosen.flights if flight not in chosen.scored]
    assert {flight.scored.run.folder.name for flight in excluded} == {"vision-latency-1-f1"}
    assert len(excluded) == len(EPISODES)
    notes = " ".join(chosen.notes)
    assert re.search(r"3 of 36 .*estimator_resets above 2", notes)
    assert re.search(r"0 of 12 at 0 s.* 0 of 12 at 0\.5 s.* 3 of 12 at 1 s", notes)
    assert re.search(r"18 flights .*estimator_resets", notes)  # flights of the oracle, whose logs have no resets
    [note, _] = load_results(changed, exclusions=[parse_exclusion("estimator_resets=3")]).notes
    assert re.search(r"0 of 36 .*estimator_resets above 3", note)


@pytest.mark.parametrize("text", ["hits", "hitz=3", "hits=many", "hits=nan", "rate_hz=1"])
def test_invalid_exclusions_are_rejected(text):
    with pytest.raises(UsageError, match=f"--exclude-above.*{text.split('=')[0]}"):
        parse_exclusion(text)


def test_changed_model_prices_do_not_prevent_loading(tmp_path, monkeypatch):
    rows = tmp_path / "models.toml"
    monkeypatch.setenv("DRONECATS_MODELS", str(rows))
    row = '[mine]\nprovider = "local"\nidentifier = "m"\nbase_url = "http://h/v1"\ninput_usd = 1\noutput_usd = 2\n'
    rows.write_text(row)
    write_study(tmp_path / "s", {"model": ("mine", "local/other")}, lambda pilot, levels: 1.0, episodes=TRACKING[:1])
    rows.write_text(row.replace("input_usd = 1", "input_usd = 3"))
    assert len(load_results(tmp_path / "s").flights) == 2
    rows.write_text("")
    assert len(load_results(tmp_path / "s").flights) == 2


def test_models_with_different_requests_are_entrants_of_different_names():
    plain = Setting("vllm/m", False, True, "flat", "", "", "paper")
    cold, hot = (replace(plain, temperature=f"temperature {t}") for t in (0, 1))
    assert _label(cold, [cold]) == "vllm/m"
    labels = [_label(setting, [cold, hot]) for setting in (cold, hot)]
    assert labels == ["vllm/m · temperature 0", "vllm/m · temperature 1"]
