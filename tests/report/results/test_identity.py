"""Tests the identity of runs: runs of one kind agree, and differences of other runs are named."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import pytest

from dronecats.report.results.identity import (
    NOT_RECORDED,
    Difference,
    deviating_runs,
    differences,
    identity,
    identity_digest,
    pooling_conflict,
    record_digest,
    served,
)
from tests.support.scores import MODEL, TOLD, a_run, named


def test_seed_and_ledger_do_not_change_the_identity():
    runs = [a_run(f"runs/{seed}", model=MODEL, seed=seed, flight={"accounts": {"ledger": f"{seed}.sqlite"}})
            for seed in range(3)]  # fmt: skip
    assert pooling_conflict(runs) is None
    assert pooling_conflict(runs[:1]) is None
    assert pooling_conflict([]) is None


# (changes of the second run, name of the difference, values of both runs)
CHANGES: list[tuple[dict[str, Any], str, tuple[str, str]]] = [
    ({"code_sha256": "b" * 64}, "code", ("a" * 64, "b" * 64)),
    ({"prompt_sha256": "d" * 64}, "prompt", ("c" * 64, "d" * 64)),
    ({"agent": "mine.agent"}, "agent", ("paper", "mine.agent")),
    ({"clock": "real time"}, "clock", ("lockstep", "real time")),
    ({"camera": None}, "camera", ('{"fov_deg": 90.0, "height": 480, "width": 640}', "null")),
    ({"map_sha256": "e" * 64}, "map", (NOT_RECORDED, "e" * 64)),
    ({"protocol": {"RADIUS_M": 3.0, "CAP_S": 300.0}}, "RADIUS_M", ("5.0", "3.0")),
    ({"suite": {"name": "one-drone", "version": 1, "sha256": "6" * 64}}, "one-drone", ("5" * 64, "6" * 64)),
    ({"suite": {"name": "quick", "version": 2, "sha256": "6" * 64}}, "version", ("1", "2")),
    ({"versions": {**TOLD["versions"], "numpy": "3.0"}}, "numpy", ("2.4.6", "3.0")),
    ({"flight": {"parser": "lenient"}}, "parser", ("strict", "lenient")),
    ({"flight": {"latency": "fixed:1"}}, "latency", ("fixed:0.5", "fixed:1")),
    ({"flight": {"disturbances": {"frame": {"delay_s": 0.5}}}}, "disturbances.frame.delay_s", ("0.0", "0.5")),
    ({"model": named("Qwen/Qwen3.5-9B", temperature=1.0)}, "model.temperature", ("0.4", "1.0")),
]


def test_agent_names_of_version_0_1_0_equal_the_current_names():
    former, now = (a_run(f"runs/{k}", model=MODEL, agent=name) for k, name in enumerate(
        ("dronecats.run.steady.steady_agent", "steady")))  # fmt: skip
    assert pooling_conflict([former, now]) is None
    assert identity_digest(identity(former)) == identity_digest(identity(now))


def test_identity_digests_equal_those_of_version_0_1_0():
    run_identity = {"the agent": frozenset({"paper"}), "the clock": frozenset({"lockstep"})}
    text = '{"the agent": ["dronecats.run.pilot.papers_agent"], "the clock": ["lockstep"]}'
    assert identity_digest(run_identity) == hashlib.sha256(text.encode()).hexdigest()


def test_differences_of_identity_are_named():
    usual = {"disturbances": {"frame": {"delay_s": 0.0}}}
    for changed, name, values in CHANGES:
        other = {**changed, "flight": {**usual, **changed.get("flight", {})}}
        runs = [a_run("runs/a", model=MODEL, flight=usual), a_run("runs/b", **{"model": MODEL, **other})]
        (difference,) = differences(identity(runs[0]), identity(runs[1]))
        assert difference.values == values, name
        message = pooling_conflict(runs) or ""
        shown = [value[:8] if len(value) == 64 else value for value in values]
        shown = (
            ["none", "640"] if name == "camera" else [value.replace(NOT_RECORDED, "not recorded") for value in shown]
        )
        for part in ("runs/a", "runs/b", "vllm/Qwen/Qwen3.5-9B", name, *shown):
            assert part in message, (name, part)
        assert not re.search(r"[0-9a-f]{9}", message), f"{name}: digests are shortened"


def test_another_suite_or_python_patch_version_is_not_a_conflict():
    other = a_run("runs/b", suite={"name": "commanding", "version": 1, "sha256": "6" * 64},
                  versions={**TOLD["versions"], "python": "3.11.9"})  # fmt: skip
    assert pooling_conflict([a_run("runs/a"), other]) is None


def test_unrecorded_values_equal_only_unrecorded_values():
    def older(name):
        configuration = {key: value for key, value in TOLD.items() if key not in ("code_sha256", "protocol", "suite")}
        run = a_run(name)
        return type(run)(folder=run.folder, configuration={**configuration, "flight": run.flight}, episodes=())

    assert pooling_conflict([older("runs/a"), older("runs/b")]) is None
    found_differences = differences(identity(older("runs/a")), identity(a_run("runs/b")))
    assert [difference.values for difference in found_differences] == [
        (NOT_RECORDED, "a" * 64),
        (NOT_RECORDED, "told"),
        (NOT_RECORDED, "1"),
    ]


def test_measured_and_unknown_fields_do_not_change_the_identity():
    measured: dict[str, Any] = {"served_rate_hz": 1.3, "pace": {"late": 3}, "schema": 1, "something_new": 2}
    assert differences(identity(a_run("runs/a")), identity(a_run("runs/b", **measured))) == []


def test_further_differing_runs_are_counted_and_not_named():
    runs = [a_run(f"runs/{k}", prompt_sha256=str(k) * 64) for k in range(4)]
    message = pooling_conflict(runs) or ""
    assert re.search(r"runs/1\b.*runs/0\b.*prompt.*1{8}.*0{8}.*\b2\b", message)
    assert "runs/2" not in message


def test_the_run_that_differs_from_most_is_named_in_any_order():
    bench = [a_run(f"runs/bench/f{k}", seed=k) for k in range(3)]
    alone = type(bench[0])(
        folder=Path("runs/alone"), episodes=(),
        configuration={key: value for key, value in bench[0].configuration.items() if key != "suite"},
    )  # fmt: skip
    for runs in ([alone, *bench], [*bench, alone], [bench[0], alone, *bench[1:]]):
        assert [run.folder for run, _ in deviating_runs(runs)] == [alone.folder]
        message = pooling_conflict(runs) or ""
        assert message.startswith("runs/alone "), message
        assert "bench" in message
    assert deviating_runs(bench) == []


def with_identity(tmp_path, name, **fields):
    folder = tmp_path / name / "campus-approaching-01"
    folder.mkdir(parents=True)
    defaults = {"record_sha256": None, "frames": 0, "frames_sha256": None}
    (folder / "identity.json").write_text(json.dumps(defaults | fields))
    run = a_run(str(folder.parent), model=MODEL)
    return type(run)(folder=run.folder, configuration=run.configuration, episodes=(folder,))


def test_the_served_model_and_the_code_of_the_flying_machine_count(tmp_path):
    a = with_identity(tmp_path, "a", served=["qwen-2026 fp_1"], code_sha256="a" * 64)
    b = with_identity(tmp_path, "b", served=["qwen-2026 fp_2"], code_sha256="a" * 64)
    assert pooling_conflict([a, a]) is None
    assert re.search("model.*qwen-2026 fp_2.*qwen-2026 fp_1", pooling_conflict([a, b]) or "")
    assert served(a.episodes[0]) == ("qwen-2026 fp_1",)
    elsewhere = with_identity(tmp_path, "c", served=["qwen-2026 fp_1"], code_sha256="b" * 64)
    assert re.search("code.*a{8}.*b{8}", pooling_conflict([elsewhere]) or "")


def test_record_digests_do_not_depend_on_json_formatting():
    assert record_digest({"a": 1, "b": [2.0]}) == record_digest(json.loads('{"b":[2.0],  "a":1}'))
    assert record_digest({"a": 1}) != record_digest({"a": 2})


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        (("null", '{"hfov_deg": 90, "width": 1280}'), "the camera (none and hfov_deg 90, width 1280)"),
        (
            ('{"hfov_deg": 90, "width": 1280}', '{"hfov_deg": 60, "width": 1280}'),
            "the camera (hfov_deg 90 and hfov_deg 60)",
        ),
        ((NOT_RECORDED, '{"lens": {"k1": 0.1}}'), "the camera (not recorded and lens.k1 0.1)"),
        (("{}", json.dumps(dict.fromkeys("abcdef", 1))), "the camera (nothing and a 1, b 1, c 1, d 1, 2 more)"),
        (("b" * 64, "real time"), "the camera (bbbbbbbb and real time)"),
    ],
)
def test_a_difference_is_printed_without_json(values, shown):
    assert str(Difference("the camera", values)) == shown
