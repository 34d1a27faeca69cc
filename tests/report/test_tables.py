"""Every table of a synthetic benchmark, compared with counts by hand."""

import json
import math
import re
from dataclasses import replace
from typing import Any

import pytest

from dronecats.judge.metrics.audit import StepOutlook
from dronecats.judge.metrics.failure_mode import MODES
from dronecats.judge.metrics.judging import METRICS
from dronecats.judge.statistics.shares import estimate_share, wilson
from dronecats.report import report_data
from dronecats.report.report_folder import tables
from dronecats.report.results.collection import Usage, without_stalled
from dronecats.report.table import TableCell
from dronecats.report.tables import comparison, measures, outcomes, setup
from dronecats.report.writers import as_html
from tests.report.small import ASKED, BAD, GOOD, PRICED, benchmark, line, made, number, small
from tests.support.scores import a_run, an_episode, collected, flights, named


def test_rates_cover_scored_flights_and_unscored_flights_have_their_own_column():
    table = made(outcomes.main, small())
    assert [column.group for column in table.columns[2:]] == ["Approaching"] * 2 + ["Tracking"] * 2 + ["All"] * 2 + [""]
    good = line(table, GOOD)
    assert (good["flights"].value, good["not_scored"].value) == (9, 1)
    sr = good["approaching_success_percent"]
    assert (sr.value, sr.count, sr.of) == (62.5, 5, 8)
    assert (good["tracking_success_percent"].value, good["tracking_success_percent"].of) == (0.0, 1)
    assert (good["all_success_percent"].count, good["all_success_percent"].of) == (5, 9)


def test_repeated_flights_of_an_episode_do_not_count_as_independent_episodes():
    sr = line(made(outcomes.main, small()), GOOD)["approaching_success_percent"]
    by_episode = [[True, True], [True, False], [False, False], [True, True]]
    expected = estimate_share(by_episode)
    assert (sr.low, sr.high) == pytest.approx((100 * expected.low, 100 * expected.high))
    low, high = wilson(5, 8)
    assert number(sr.low) < 100 * low < 100 * high < number(sr.high)
    bad = line(made(outcomes.main, small()), BAD)["approaching_success_percent"]
    assert (bad.low, bad.high) == pytest.approx(tuple(100 * end for end in wilson(1, 4)))


def test_models_and_built_in_pilots_never_share_a_block_and_notes_describe_the_pilots():
    data = small()
    for table in (
        made(outcomes.main, data),
        made(outcomes.approaching, data),
        made(measures.declarations, data),
        made(comparison.comparison, data),
    ):
        for block in table.blocks[:2]:
            names = {cell.value for row in block.rows for cell in row.cells[:2] if isinstance(cell.value, str)}
            assert block.title in (report_data.MODELS, report_data.BUILT_IN)
            assert names <= ({GOOD, BAD} if block.title == report_data.MODELS else {"oracle", "blind:fan"})
    notes = made(setup.setup, data).notes
    assert notes[0].startswith("oracle ")
    assert notes[1].startswith("blind:fan ")


def test_the_best_value_is_marked_among_models_only():
    table = made(outcomes.main, small())
    marked = [row.entrant for row in table.rows if any(cell.best for cell in row.cells)]
    assert marked == [GOOD]
    assert line(table, GOOD)["approaching_success_percent"].best
    assert not line(table, GOOD)["tracking_success_percent"].best, "both have none"
    assert not line(made(outcomes.approaching, small()), GOOD)["flights"].best, "more flights are not better"


def test_the_floor_of_blind_pilots_covers_the_same_episodes():
    table = made(outcomes.main, small())
    below = line(table, report_data.BLIND_ROW_TITLE)
    sr = below["approaching_success_percent"]
    assert (sr.value, sr.count, sr.of) == (25.0, 1, 4)
    assert below["tracking_success_percent"].value is None, "no blind pilot has flown it"
    assert below["approaching_oracle_success_percent"].value is None
    assert "blind:fan" in table.notes[0]
    assert "ring" not in table.notes[0]
    assert table.blocks[-1].title == ""


def test_the_per_map_table_has_a_column_for_each_map_and_cell():
    table = made(outcomes.per_map, small())
    good = line(table, GOOD)
    texts = {name: cell.text(column) for (name, cell), column in zip(good.items(), table.columns, strict=True)}
    assert list(texts.values()) == [GOOD, "3/4", "0/1", "2/4"]
    assert list(texts)[1:3] == ["campus_approaching_success_percent", "campus_tracking_success_percent"]
    assert [column.group for column in table.columns[1:]] == ["Campus", "Campus", "Residential"]
    assert line(table, "oracle")["residential_approaching_success_percent"] == TableCell(value=None)


def test_the_per_map_table_shows_counts_without_a_percent_sign():
    table = made(outcomes.per_map, small())
    assert "%" not in as_html(table)
    assert "<small>%</small>" in as_html(made(outcomes.main, small()))


def test_unreadable_replies_are_listed_for_models_only():
    run = a_run("runs/a", model=named("a"))
    few_replies = {"decisions": 40, "unreadable": 4, "refused": 1, "cut_off": 2}
    good_replies = {"decisions": 60, "unreadable": 0, "refused": 0, "cut_off": 0}
    episodes = [
        an_episode(run, "campus-approaching-01", values=few_replies),
        an_episode(run, "campus-tracking-01", values=good_replies),
    ]
    built_in = [an_episode(a_run("runs/o", pilot="oracle"), "campus-tracking-01", values=good_replies)]
    table = made(measures.replies, small(collected(episodes, built_in)))
    assert [row.entrant for row in table.rows] == ["vllm/a"]
    shares = line(table, "vllm/a")
    assert [shares[f"{name}_percent"].value for name in ("unreadable", "refused", "cut_off")] == [4.0, 1.0, 2.0]
    assert (shares["decisions"].value, shares["unreadable_flights"].value) == (100, 1)
    assert measures.replies(small(collected(built_in))) is None


def test_the_setup_table_shows_the_reasoning_switch():
    own = named("a", provider="openai", quick={"reasoning_effort": "minimal"}, thinking={"reasoning_effort": "low"})
    providers = named("b", provider="openrouter")
    runs = [a_run("runs/a", model=own), a_run("runs/b", model=providers), a_run("runs/c", model=named("c", quick={}))]
    table = made(setup.setup, small(collected(*(flights(run, {"campus-tracking": "s"}) for run in runs))))
    reasoning = {row.entrant: line(table, row.entrant)["reasoning"].value for row in table.rows}
    assert reasoning["openai/a"] == "reasoning_effort minimal | reasoning_effort low"
    assert reasoning["openrouter/b"] == "reasoning.enabled false | reasoning.enabled true"
    assert str(reasoning["vllm/c"]).startswith("nothing | ")


def test_the_served_name_is_shown_only_if_it_differs_from_the_requested_name(tmp_path):
    served = {"same": ["same"], "other": ["other-2026", "other"], "silent": []}
    runs = []
    for name, answered in served.items():
        run = replace(a_run(str(tmp_path / name), model=named(name)), episodes=(tmp_path / name / "e",))
        (tmp_path / name / "e").mkdir(parents=True)
        (tmp_path / name / "e" / "identity.json").write_text(json.dumps(
            {"code_sha256": "a" * 64, "record_sha256": None, "frames": 0, "frames_sha256": None, "served": answered}
        ))  # fmt: skip
        runs.append(run)
    table = made(setup.setup, small(collected(*(flights(run, {"campus-tracking": "s"}) for run in runs))))
    served_names = {row.entrant: line(table, row.entrant)["served"].value for row in table.rows}
    assert served_names == {"vllm/same": None, "vllm/other": "other-2026", "vllm/silent": None}


def test_a_standard_deviation_is_labelled_with_its_number_of_flights():
    table = made(comparison.variance, small())
    assert "s.d. of 2" in {row.cells[1].value for row in table.rows}
    assert [note for note in table.notes if "two flights" in note]


def test_costs_show_cached_and_reasoning_tokens_and_the_endpoints():
    run = a_run("runs/a", model=named("a"))
    used = [
        Usage(questions=10, tokens_in=1000, tokens_out=100, cached=512, reasoning=60,
              endpoints=("Novita", "DeepInfra")),
        Usage(questions=10, tokens_in=1000, tokens_out=100, reasoning=20, endpoints=("DeepInfra",)),
    ]  # fmt: skip
    episodes = [an_episode(run, f"campus-approaching-{k:02}", usage=usage) for k, usage in enumerate(used, 1)]
    row = line(made(setup.costs, small(collected(episodes))), "vllm/a")
    assert (row["tokens_cached"].value, row["tokens_cached"].of) == (512, 1)
    assert (row["tokens_reasoning"].value, row["tokens_reasoning"].of) == (40, 2)
    assert row["endpoints"].value == "DeepInfra, Novita"


def test_approaching_means_omit_missing_values():
    run = a_run("runs/a", model=named("a"))
    episodes = [
        an_episode(run, "campus-approaching-01", "success", values={"ne_m": 4.0, "approach_ratio": 0.8,
                                                                    "declared_to_start": 0.2}, censored=True),
        an_episode(run, "campus-approaching-02", values={"ne_m": 20.0, "approach_ratio": 0.4,
                                                         "declared_to_start": None, "oracle_success": True}),
        an_episode(run, "campus-approaching-03", "error"),
        an_episode(run, "campus-tracking-01", values={"ne_m": 99.0}),
    ]  # fmt: skip
    table = made(outcomes.approaching, small(collected(episodes)))
    row = line(table, "vllm/a")
    assert (row["flights"].value, row["ne_m"].value, row["ne_m"].of) == (2, 12.0, 2)
    assert (row["declared_to_start_ratio"].value, row["declared_to_start_ratio"].of) == (0.2, 1)
    assert row["approach_ratio"].value == pytest.approx(0.6)
    assert row["approaching_oracle_success_percent"].value == 100.0
    assert row["approaching_declared_percent"].value == 50.0
    assert re.search(r"\b1\b", table.notes[0])


def test_declarations_pool_all_cells():
    run = a_run("runs/a", model=named("a"))
    first = {"success_at_first": True, "success_within_three": True, "declarations": 2, "false_declarations": 1,
             "declaration_precision": 0.5}  # fmt: skip
    never = {"success_at_first": False, "success_within_three": False, "declarations": 0, "false_declarations": 0,
             "declaration_precision": None}  # fmt: skip
    episodes = [an_episode(run, "campus-approaching-01", "success", values=first),
             an_episode(run, "blocks-commanding-01", values=never)]  # fmt: skip
    row = line(made(measures.declarations, small(collected(episodes))), "vllm/a")
    assert row["all_success_at_first_percent"].value == 50.0
    assert (row["declarations_per_flight"].value, row["false_per_flight"].value) == (1.0, 0.5)
    assert (row["precision_percent"].value, row["precision_percent"].of) == (50.0, 1)


def test_each_scored_flight_of_one_drone_has_one_failure_mode_or_succeeds():
    run = a_run("runs/a", model=named("a"))
    ended = ["success", "declared", "declared", "did not move", "timed out"]
    episodes = [an_episode(run, f"campus-searching-{k:02}", "success" if mode == "success" else "failure", mode=mode)
             for k, mode in enumerate(ended)]  # fmt: skip
    episodes += [
        an_episode(run, "campus-searching-09", "error"),
        an_episode(run, "blocks-commanding-01", mode="arrived"),
    ]
    table = made(outcomes.failures, small(collected(episodes)))
    row = line(table, "vllm/a")
    shares = {name: cell.value for name, cell in row.items() if name.endswith("percent")}
    assert row["flights"].value == 5
    assert sum(number(share) for share in shares.values()) == pytest.approx(100.0)
    assert {name for name, share in shares.items() if share} == {
        "success_percent", "declared_percent", "did_not_move_percent", "timed_out_percent",
    }  # fmt: skip
    assert shares["declared_percent"] == 40.0


def test_the_commanding_table_shows_fleets_beside_single_drones():
    table = made(outcomes.commanding, small())
    good = line(table, GOOD)
    assert (good["approaching_success_percent"].count, good["approaching_success_percent"].of) == (5, 8)
    assert (good["commanding_success_percent"].count, good["commanding_success_percent"].of) == (1, 2)
    assert good["commanding_declared_percent"].value == 100.0
    assert good["commanding_oracle_success_percent"].value == 50.0
    assert [row.entrant for row in table.rows] == [GOOD], "who flew no fleet has no line"


def test_each_drone_of_each_fleet_flight_has_one_outcome():
    row = line(made(outcomes.drones, small()), GOOD)
    assert row["drones"].value == 8
    counts = [row[f"drones_{name}_percent"].count for name in ("found", "beside", "elsewhere", "silent")]
    assert counts == [1, 3, 1, 3]
    assert row["commanding_success_percent"].value == 50.0


def test_variance_covers_the_episodes_that_every_flight_scored():
    table = made(comparison.variance, small())
    lines = {str(row.cells[1].value): row.cells for row in table.rows}
    assert list(lines) == ["1", "2", "mean", "s.d. of 2", "binomial", "by episode"]
    approaching = [column.name for column in table.columns].index("approaching_successes")
    assert [lines[k][approaching].value for k in ("1", "2", "mean")] == [3, 2, 2.5]
    assert lines["s.d. of 2"][approaching].value == pytest.approx(math.sqrt(0.5))
    assert lines["binomial"][approaching].value == pytest.approx(math.sqrt(4 * 0.625 * 0.375))
    assert lines["by episode"][approaching].value == pytest.approx(math.sqrt(0.5)), "one of four differed"
    assert number(lines["s.d. of 2"][approaching].high) > math.sqrt(0.5) > number(lines["s.d. of 2"][approaching].low)
    _, note = table.notes
    assert re.search(rf"{GOOD}\b.*\b1\b", note)
    assert comparison.variance(small(collected(flights(a_run(), {"campus-approaching": "sf"})))) is None


def test_pairs_use_the_episodes_that_both_entrants_flew():
    table = made(comparison.comparison, small())
    models = table.blocks[0].rows
    assert len(models) == 1
    values = {column.name: cell.value for column, cell in zip(table.columns, models[0].cells, strict=True)}
    # first: campus 01 s s, 02 s f, residential 01 f f, 02 s s, tracking 01 f; second: f f f s f
    assert values["episodes"] == 5
    assert (values["only_first"], values["only_second"]) == (2, 0)
    assert values["difference_points"] == pytest.approx(100 * (1 + 0.5) / 5)
    assert (values["p"], values["p_holm"]) == (0.5, 0.5)
    assert values["smallest_points"] is None, "five episodes show no difference"
    pilots = table.blocks[1].rows[0].cells
    assert [pilots[k].value for k in (0, 1, 3)] == ["oracle", "blind:fan", 2]


def test_holm_corrects_for_all_pairs_of_a_block():
    some = [flights(a_run(f"runs/{name}", model=named(name)), {"campus-approaching": letters})
            for name, letters in (("a", "s" * 10), ("b", "f" * 10), ("c", "sssss" + "f" * 5))]  # fmt: skip
    table = made(comparison.comparison, small(collected(*some)))
    ps = [row.cells[7].value for row in table.rows]
    assert ps == [2 / 1024, 2 / 32, 2 / 32]
    assert [row.cells[8].value for row in table.rows] == pytest.approx([6 / 1024, 4 / 32, 4 / 32])


def test_costs_use_the_declared_prices_and_are_omitted_without_a_price():
    table = made(setup.costs, small())
    good = line(table, GOOD)
    assert [row.entrant for row in table.rows] == [GOOD], "nobody else tells tokens"
    assert good["flights"].value == 12
    assert good["usd"].value == pytest.approx(10 * 0.002)
    assert good["usd_per_success"].value == pytest.approx(10 * 0.002 / 6)
    assert (good["tokens_in"].value, good["tokens_in"].of) == (1000.0, 10)
    free = a_run("runs/free", model=named("free"))
    episodes = flights(free, {"campus-approaching": "s"}, usage=costs_of(1))
    assert line(made(setup.costs, small(collected(episodes))), "vllm/free")["usd"].value is None


def test_costs_leave_out_a_scripted_commander():
    flight = {"command": "hierarchical", "scripted": "scripted:divide"}
    run = a_run("runs/a", model=named("a", **PRICED), flight=flight)
    usage = replace(ASKED, commander_questions=4, commander_in=500, commander_out=50)
    episodes = flights(run, {"blocks-commanding": "s"}, usage=usage)
    (row,) = made(setup.costs, small(collected(episodes))).rows
    questions, tokens_in, tokens_out = row.cells[2], row.cells[3], row.cells[5]
    assert (questions.value, tokens_in.value, tokens_out.value) == (10, 1000, 100)
    assert row.cells[7].value == pytest.approx(0.002)


def costs_of(questions):
    return Usage(questions=questions, tokens_in=10, tokens_out=1)


def test_rates_are_quantiles_over_steps_and_host_stalls_are_separate():
    run = a_run("runs/a", model=named("a"))
    episodes = [
        an_episode(run, "campus-approaching-01", steps={"rate_hz": (None, 1.0, 2.0), "latency_s": (0.1, 0.2, 0.3)},
                   host_stalls=2, usage=costs_of(8)),
        an_episode(run, "campus-approaching-02", steps={"rate_hz": (3.0, 4.0, 5.0)}, host_stalls=0, usage=costs_of(12)),
        an_episode(run, "campus-approaching-03", "error", steps={"rate_hz": (99.0,)}, host_stalls=7),
    ]  # fmt: skip
    row = line(made(measures.served, small(collected(episodes))), "vllm/a")
    assert [row[f"rate_{q}_hz"].value for q in (5, 25, 50, 75, 95)] == pytest.approx([1.2, 2.0, 3.0, 4.0, 4.8])
    assert row["steps"].value == 5
    assert (row["stalled_steps_percent"].value, row["stalled_flights"].value) == (10.0, 1)


def test_grounding_uses_only_steps_with_a_value():
    run = a_run("runs/a", model=named("a"))
    steps = {"on_target": (True, None, False, True), "pointing_error_deg": (1.0, None, 9.0, 2.0),
             "depth_error_m": (-2.0, None, None, 6.0), "depth_error_abs_m": (2.0, None, None, 6.0),
             "rescaled": (None, None, True, False), "wide_rotation": (None, True, None, None)}  # fmt: skip
    row = line(
        made(measures.grounding, small(collected([an_episode(run, "campus-approaching-01", steps=steps)]))), "vllm/a"
    )
    assert (row["on_target_percent"].count, row["on_target_percent"].of) == (2, 3)
    assert (row["gos"].value, row["pointing_50_deg"].value) == (3, 2.0)
    assert (row["depth_50_m"].value, row["depth_absolute_50_m"].value) == (2.0, 4.0)
    assert (row["rescaled_percent"].value, row["wide_percent"].value) == (50.0, 100.0)


def test_a_think_is_compared_with_other_steps_of_the_same_closing_rate():
    def step(think, closing_m=None, gained_m=None, stalled=None, broken=None, lost=None, regained=None):
        return StepOutlook(think, closing_m, gained_m, stalled, broken, lost, regained)

    run = a_run("runs/a", model=named("a"))
    first = (step(True, 0.1, 0.5, True, True), step(False, 0.1, 0.2, True, False), step(False, 9.0, 9.0))
    second = (step(False, 0.1, 0.4, True, True, True, False), step(True, lost=True, regained=True))
    episodes = [
        an_episode(run, f"campus-approaching-0{k}", step_outlooks=steps) for k, steps in enumerate((first, second))
    ]
    episodes.append(an_episode(run, "campus-approaching-09", "error", step_outlooks=first))
    row = line(made(measures.thinking, small(collected(episodes))), "vllm/a")
    assert (row["thinks"].value, row["matched"].value) == (2, 1)
    assert row["gain_m_per_step"].value == pytest.approx(0.5 - 0.3)
    assert (row["stalls_after_think_percent"].count, row["stalls_after_think_percent"].of) == (1, 1)
    assert (row["stalls_after_other_percent"].count, row["stalls_after_other_percent"].of) == (1, 2)
    assert (row["losses_after_think_percent"].value, row["losses_after_other_percent"].value) == (100.0, 0.0)


def test_entrants_without_scored_flights_have_no_rows():
    nothing = small(collected(flights(a_run(), {"campus-approaching": "ee"})))
    assert measures.declarations(nothing) is None
    for table in (outcomes.failures, outcomes.drones, outcomes.commanding, setup.costs, measures.served,
                  measures.grounding, measures.thinking, comparison.comparison, comparison.variance):  # fmt: skip
        assert table(nothing) is None
    assert line(made(outcomes.main, nothing), "vision")["not_scored"].value == 2


def test_rows_with_different_settings_have_a_warning():
    other = a_run("runs/b", pilot="oracle", code_sha256="b" * 64, flight={"latency": "fixed:0.1"})
    data = small(
        collected(flights(a_run("runs/a"), {"campus-approaching": "s"}), flights(other, {"campus-approaching": "s"}))
    )
    (warning,) = data.warnings()
    assert re.search("code.*aaaaaaaa.*bbbbbbbb", warning)
    assert small(benchmark()).warnings() == ()
    pooled = [flights(a_run(f"runs/{k}", seed=k, clock=f"clock {k}"), {"campus-approaching": "s"}) for k in range(2)]
    assert "runs/0" in small(collected(*pooled), pool_anyway=True).warnings()[0]


class OnlyMetrics(dict[str, Any]):
    """Values of metrics. Only names of metrics are valid keys."""

    def get(self, key, default=None):
        assert key in METRICS, key
        return super().get(key, default)


def test_tables_look_up_metrics_by_their_names():
    episodes = tuple(replace(e, values=OnlyMetrics(e.values), steps=OnlyMetrics(e.steps)) for e in benchmark().episodes)
    assert tables(small(replace(benchmark(), episodes=episodes)))
    assert {mode.name for mode in report_data.FAILURE_MODE_COLUMNS} == set(MODES)


def test_stalled_flights_can_be_omitted_and_are_not_counted_as_unscored():
    run = a_run("runs/a", model=named("a"))
    episodes = [
        an_episode(run, "campus-approaching-01", "success", host_stalls=3),
        an_episode(run, "campus-approaching-02", "success", host_stalls=0),
        an_episode(run, "campus-approaching-03", "failure"),
    ]
    row = line(made(outcomes.main, small(without_stalled(collected(episodes)))), "vllm/a")
    assert (row["approaching_success_percent"].count, row["approaching_success_percent"].of) == (1, 2)
    assert row["not_scored"].value == 1
