"""The suite as an Inspect task: Inspect's model flies it, our verifier scores it, and errors stay unscored.

Importing Inspect takes five seconds. The tests are therefore marked slow, and each of them imports it.
"""

import json
import math
from pathlib import Path
from typing import Any, cast

import pytest

from foundation.errors import UsageError

pytestmark = pytest.mark.slow

EPISODES = "residential-approaching-03,blocks-commanding-01"
GO = '{"action": "go", "point": [500, 520], "depth_m": 10}'
FLEET = "[" + ", ".join([GO] * 4) + "]"


def model_output(text):
    from inspect_ai.model import ModelOutput, ModelUsage

    usage = ModelUsage(input_tokens=10, output_tokens=2, total_tokens=12)
    output = ModelOutput.from_content("mockllm/model", text)
    output.usage = usage
    return output


def run(tmp_path, answer, episodes=EPISODES, reasoning_effort=None, seconds=8.0, message_limit=None, **options):
    from inspect_ai import eval as evaluate
    from inspect_ai.log import read_eval_log
    from inspect_ai.model import get_model

    from dronecats.bench.harnesses.inspect_task import dronecats

    model = get_model("mockllm/model", custom_outputs=answer, memoize=False)
    task = dronecats(episodes, seconds=seconds, out=str(tmp_path / "runs"), **options)
    (log,) = evaluate(task, model=model, log_dir=str(tmp_path / "logs"), display="none", fail_on_error=False,
                      reasoning_effort=reasoning_effort, message_limit=message_limit)  # fmt: skip
    return read_eval_log(log.location)


def test_replies_of_the_inspect_model_are_executed_and_scored(tmp_path):
    def answer(question, tools, choice, config):
        pictures = sum(part.type == "image" for part in question[0].content)
        assert (config.temperature, config.max_tokens) == (0.4, 8192)
        return model_output(FLEET if pictures == 4 else GO)

    log = run(tmp_path, answer, seconds=4.0)
    assert log.status == "success"
    assert {sample.id for sample in log.samples} == set(EPISODES.split(","))
    for sample in log.samples:
        score = sample.scores["verdict"]
        assert score.value == "I"
        folder = Path(score.metadata["folder"])
        assert json.loads((folder / "verdict.json").read_text())["outcome"] == score.metadata["outcome"] == "failure"
        rows = [json.loads(line) for line in (folder / "decisions.jsonl").open()]
        assert {row["reply"] for row in rows} == {FLEET if sample.id.startswith("blocks") else GO}
        assert rows[0]["tokens_in"] == 10
        user_messages = [message for message in sample.messages if message.role == "user"]
        assert len(user_messages) == len({row["step"] for row in rows}) + 1  # the sample's own input comes first
    metrics = log.results.scores[0].metrics
    assert {"accuracy", "approaching", "commanding", "residential", "blocks"} <= set(metrics)


def test_each_model_and_epoch_has_its_own_run_folder(tmp_path, refused):
    from inspect_ai import eval as evaluate

    from dronecats.bench.harnesses import inspect_task

    runs = refused(inspect_task)
    task = inspect_task.dronecats(EPISODES, out=str(tmp_path / "runs"))
    models = ["mockllm/one", "mockllm/two"]
    evaluate(task, model=models, epochs=2, log_dir=str(tmp_path / "logs"), display="none", fail_on_error=False)
    assert len(runs) == len(set(runs)) == 2 * 2 * 2  # episodes, epochs, models
    names = [f"mockllm-{model}-flight{epoch}" for model in ("one", "two") for epoch in (1, 2)]
    assert sorted({run.name for _, run in runs}) == names


@pytest.mark.parametrize("lifted", [None, "high"])
def test_think_raises_the_reasoning_effort_of_the_next_call_only(tmp_path, lifted):
    words = ['{"action": "think"}', GO, GO]
    efforts = []

    def answer(question, tools, choice, config):
        assert (config.temperature, config.max_tokens) == (0.4, 8192)
        efforts.append(config.reasoning_effort)
        return model_output(words[min(len(efforts), len(words)) - 1])

    log = run(tmp_path, answer, episodes=EPISODES.split(",")[0], lifted=lifted, reasoning_effort="low")
    (sample,) = log.samples
    folder = Path(sample.scores["verdict"].metadata["folder"])
    rows = [json.loads(line) for line in (folder / "decisions.jsonl").open()]
    assert [row["thinking"] for row in rows[:3]] == [False, True, False]
    assert efforts == [lifted if row["thinking"] and lifted else "low" for row in rows]
    assert json.loads((folder.parent / "run.json").read_text())["flight"]["outside"].get("lifted") == lifted


@pytest.mark.parametrize("text", [EPISODES, json.dumps(EPISODES.split(","))])
def test_a_list_of_episodes_is_read_from_the_inspect_command_line(text):
    from inspect_ai._cli.util import parse_cli_args  # type: ignore[attr-defined]

    from dronecats.bench.harnesses.inspect_task import dronecats

    task = dronecats(**parse_cli_args((f"suite={text}",)))
    assert [sample.id for sample in task.dataset] == EPISODES.split(",")


def test_unknown_values_of_options_are_rejected():
    from dronecats.bench.harnesses.inspect_task import dronecats

    with pytest.raises(UsageError, match=r"-T lifted .*minimal, .*'much'"):
        dronecats("quick", lifted=cast(Any, "much"))
    with pytest.raises(UsageError, match=r"-T axis_order .*'zy'"):
        dronecats("quick", axis_order="zy")


def test_a_failing_model_gives_an_error_and_no_score(tmp_path):
    def answer(question, tools, choice, config):
        raise ConnectionError("the vendor is away")

    log = run(tmp_path, answer)
    for sample in log.samples:
        assert sample.error is not None
        assert not sample.scores


def test_a_sample_that_a_limit_ends_is_not_scored(tmp_path):
    log = run(tmp_path, lambda *question: model_output(GO), episodes=EPISODES.split(",")[0], message_limit=4)
    (sample,) = log.samples
    assert sample.limit.type == "message"
    score = sample.scores["verdict"]
    assert score.metadata["outcome"] == "error"
    assert math.isnan(score.value)
    assert (log.results.scores[0].scored_samples, log.results.scores[0].unscored_samples) == (0, 1)
