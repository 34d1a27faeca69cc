"""Tests the entrants of the tables, and the runs that are rejected."""

import pytest

from dronecats.report.report_data import entrants
from foundation.errors import UsageError
from tests.support.scores import MODEL, a_run, an_episode, collected, flights, named

ONE = {"campus-approaching": "sf"}


def labels(*some, **options):
    return [entrant.label for entrant in entrants(collected(*some), **options)]


def test_runs_of_one_configuration_are_one_entrant_with_separate_episodes():
    runs = [a_run(f"runs/{seed}", model=MODEL, seed=seed) for seed in (1, 0)]
    (entrant,) = entrants(collected(flights(runs[0], ONE), flights(runs[1], {"campus-approaching": "fe"})))
    assert (entrant.label, entrant.is_model) == ("vllm/Qwen/Qwen3.5-9B", True)
    assert [[episode.success for episode in entrant.by_episode[name]] for name in entrant.by_episode] == [
        [False, True],
        [False],
    ]
    assert (len(entrant.episodes), len(entrant.scored)) == (4, 3)


def test_models_come_before_built_in_pilots_and_a_replay_is_not_a_model():
    some = [
        flights(a_run("runs/o", pilot="oracle"), ONE),
        flights(a_run("runs/r", model=MODEL, flight={"replay": {"steps": []}}), ONE),
        flights(a_run("runs/m", model=MODEL), ONE),
    ]
    rows = entrants(collected(*some))
    assert [(e.label, e.is_model) for e in rows] == [
        ("vllm/Qwen/Qwen3.5-9B", True), ("oracle", False), ("replay of vllm/Qwen/Qwen3.5-9B", False),
    ]  # fmt: skip


def test_a_label_has_only_the_settings_that_distinguish_it():
    some = [
        flights(a_run("runs/a"), ONE),
        flights(a_run("runs/b", flight={"latency": "fixed:1"}), ONE),
        flights(a_run("runs/c", flight={"command": "solo"}), ONE),
        flights(a_run("runs/d", pilot="oracle"), ONE),
    ]
    assert labels(*some) == ["vision, flat, fixed:0.5", "vision, flat, fixed:1", "vision, solo, fixed:0.5", "oracle"]
    by_model = [flights(a_run(f"runs/{name}", flight={"command": "hierarchical", "commander": named(name)}), ONE)
                for name in "xy"]  # fmt: skip
    assert labels(*by_model) == ["vision, vllm/x", "vision, vllm/y"]


def test_another_agent_is_always_named_and_has_its_own_row():
    made = {"steady": "dronecats.run.steady.steady_agent", "mine:agent": "mine.agent"}
    others = [flights(a_run(f"runs/{k}", flight={"agent": name}, agent=made[name]), ONE) for k, name in enumerate(made)]
    papers = [flights(a_run("runs/p", flight={"agent": "paper"}), ONE), flights(a_run("runs/q", seed=1), ONE)]
    assert labels(*papers, *others) == ["vision", "vision · steady", "vision · mine:agent"]
    assert labels(others[0]) == ["vision · steady"]
    assert [len(entrant.runs) for entrant in entrants(collected(*papers, *others))] == [2, 1, 1]
    made_only = flights(
        a_run("runs/o", agent="mine.agent"), ONE
    )  # as in runs of older versions, whose flight has no agent
    assert labels(*papers, made_only) == ["vision", "vision · mine.agent"]


def test_runs_of_different_kinds_are_rejected_without_pool_anyway():
    some = [flights(a_run(f"runs/{k}", seed=k, prompt_sha256=str(k) * 64), ONE) for k in range(2)]
    with pytest.raises(UsageError, match=r"prompt.*1{8}.*0{8}.*--pool-anyway"):
        entrants(collected(*some))
    (entrant,) = entrants(collected(*some), pool_anyway=True)
    assert len(entrant.scored) == 4


def test_one_flight_twice_is_rejected_without_pool_anyway():
    some = [flights(a_run(f"runs/{k}"), ONE) for k in range(2)]
    with pytest.raises(UsageError, match=r"campus-approaching-01.*seed 0.*--pool-anyway"):
        entrants(collected(*some))
    assert len(entrants(collected(*some), pool_anyway=True)[0].scored) == 4


def test_two_records_of_one_id_are_rejected_for_any_pilot():
    a = an_episode(a_run("runs/a"), "campus-approaching-01", record_sha256="1" * 64)
    b = an_episode(a_run("runs/b", pilot="oracle"), "campus-approaching-01", record_sha256="2" * 64)
    for anyway in (False, True):
        with pytest.raises(UsageError, match="campus-approaching-01"):
            entrants(collected([a], [b]), pool_anyway=anyway)


def test_a_model_with_two_request_settings_is_two_entrants():
    efforts = [named("m", quick={"reasoning_effort": word}) for word in ("low", "high")]
    some = [flights(a_run(f"runs/{k}", model=model), ONE) for k, model in enumerate(efforts)]
    labels = [entrant.label for entrant in entrants(collected(*some))]
    assert [word in label for word, label in zip(("low", "high"), labels, strict=True)] == [True, True]
    assert not [label for label in labels if "max_tokens" in label]  # both models have the same max_tokens
