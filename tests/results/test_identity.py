"""Which runs are of one kind, and in what others differ."""

import json
from typing import Any

import pytest

from dronecats.results.identity import differences, identity, record_digest, refusal, served
from tests.support.scores import MODEL, TOLD, a_run, named


def test_flights_of_one_kind_differ_in_their_seed_and_in_who_pays():
    runs = [a_run(f"runs/{seed}", model=MODEL, seed=seed, flight={"accounts": {"ledger": f"{seed}.sqlite"}})
            for seed in range(3)]  # fmt: skip
    assert refusal(runs) is None
    assert refusal(runs[:1]) is None
    assert refusal([]) is None


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"code_sha256": "b" * 64}, "the code (aaaaaaaa and bbbbbbbb)"),
        ({"prompt_sha256": "d" * 64}, "the prompt (cccccccc and dddddddd)"),
        ({"agent": "mine.agent"}, "the agent (dronecats.run.pilot.papers_agent and mine.agent)"),
        ({"clock": "real time"}, "the clock (lockstep and real time)"),
        ({"camera": None}, 'the camera ({"fov_deg": 90.0, "height": 480, "width": 640} and null)'),
        ({"map_sha256": "e" * 64}, "the map (not told and eeeeeeee)"),
        ({"protocol": {"RADIUS_M": 3.0, "CAP_S": 300.0}}, "the protocol's RADIUS_M (5.0 and 3.0)"),
        ({"suite": {"name": "one-drone", "version": 1, "sha256": "6" * 64}},
         "the suite one-drone (55555555 and 66666666)"),
        ({"suite": {"name": "quick", "version": 2, "sha256": "6" * 64}}, "the suite's version (1 and 2)"),
        ({"versions": {**TOLD["versions"], "numpy": "3.0"}}, "the version of numpy (2.4.6 and 3.0)"),
        ({"flight": {"parser": "lenient"}}, "parser (strict and lenient)"),
        ({"flight": {"latency": "fixed:1"}}, "latency (fixed:0.5 and fixed:1)"),
        ({"flight": {"disturbances": {"frame": {"delay_s": 0.5}}}}, "disturbances.frame.delay_s (0.0 and 0.5)"),
        ({"model": named("Qwen/Qwen3.5-9B", temperature=1.0)}, "model.temperature (0.4 and 1.0)"),
    ],
)  # fmt: skip
def test_what_makes_another_kind_is_named(changed, what):
    usual = {"disturbances": {"frame": {"delay_s": 0.0}}}
    other = {**changed, "flight": {**usual, **changed.get("flight", {})}}
    runs = [a_run("runs/a", model=MODEL, flight=usual), a_run("runs/b", **{"model": MODEL, **other})]
    said = refusal(runs)
    assert said == (
        f"runs/a and runs/b, both of vllm/Qwen/Qwen3.5-9B, differ in {what}:"
        " runs of different kinds are not counted together"
    )


def test_another_suite_holds_other_episodes_and_a_patch_of_python_changes_no_number():
    other = a_run("runs/b", suite={"name": "commanding", "version": 1, "sha256": "6" * 64},
                  versions={**TOLD["versions"], "python": "3.11.9"})  # fmt: skip
    assert refusal([a_run("runs/a"), other]) is None


def test_what_is_not_told_is_equal_to_its_like_alone():
    def older(name):
        told = {key: value for key, value in TOLD.items() if key not in ("code_sha256", "protocol", "suite")}
        run = a_run(name)
        return type(run)(folder=run.folder, configuration={**told, "flight": run.flight}, episodes=())

    assert refusal([older("runs/a"), older("runs/b")]) is None
    said = refusal([older("runs/a"), a_run("runs/b")]) or ""
    assert "the code (not told and aaaaaaaa)" in said
    assert "the protocol (not told and told)" in said
    assert "the suite's version (not told and 1)" in said


def test_measured_things_make_no_kind():
    measured: dict[str, Any] = {"served_rate_hz": 1.3, "pace": {"late": 3}, "schema": 1, "something_new": 2}
    assert differences(identity(a_run("runs/a")), identity(a_run("runs/b", **measured))) == []


def test_the_rest_that_differs_is_counted():
    runs = [a_run(f"runs/{k}", prompt_sha256=str(k) * 64) for k in range(4)]
    assert (refusal(runs) or "").startswith(
        "runs/0 and runs/1, both of vision, differ in the prompt (00000000 and 11111111); 2"
    )


def with_identity(tmp_path, name, **told):
    folder = tmp_path / name / "campus-approaching-01"
    folder.mkdir(parents=True)
    flown = {"record_sha256": None, "frames": 0, "frames_sha256": None}
    (folder / "identity.json").write_text(json.dumps(flown | told))
    run = a_run(str(folder.parent), model=MODEL)
    return type(run)(folder=run.folder, configuration=run.configuration, episodes=(folder,))


def test_the_model_as_it_was_served_and_the_code_of_the_machine_that_flew_count(tmp_path):
    a = with_identity(tmp_path, "a", served=["qwen-2026 fp_1"], code_sha256="a" * 64)
    b = with_identity(tmp_path, "b", served=["qwen-2026 fp_2"], code_sha256="a" * 64)
    assert refusal([a, a]) is None
    assert "the model as served (qwen-2026 fp_1 and qwen-2026 fp_2)" in (refusal([a, b]) or "")
    assert served(a.episodes[0]) == ("qwen-2026 fp_1",)
    elsewhere = with_identity(tmp_path, "c", served=["qwen-2026 fp_1"], code_sha256="b" * 64)
    assert "were flown by different code (aaaaaaaa and bbbbbbbb)" in (refusal([elsewhere]) or "")


def test_a_record_is_known_however_its_file_is_laid_out():
    assert record_digest({"a": 1, "b": [2.0]}) == record_digest(json.loads('{"b":[2.0],  "a":1}'))
    assert record_digest({"a": 1}) != record_digest({"a": 2})
