"""Runs the benchmark as an Inspect task, with the suite as dataset, the flight as solver and the judge as scorer.

    inspect eval dronecats/dronecats --model PROVIDER/NAME -T suite=quick
    inspect view

Inspect calls the model, with Inspect's retries, limits and cache. Prompt, pictures, controller, autopilot and logger
are those of `dronecats fly`. The flights write ordinary run folders.
"""

import base64
import re
from pathlib import Path
from typing import Any, Literal, get_args

import anyio
from anyio.to_thread import run_sync
from inspect_ai import Task, task
from inspect_ai.dataset import MemoryDataset, Sample
from inspect_ai.model import ChatMessageUser, Content, ContentImage, ContentText, GenerateConfig, get_model
from inspect_ai.scorer import CORRECT, INCORRECT, Score, Scorer, Target, accuracy, grouped, scorer, stderr
from inspect_ai.solver import Generate, Solver, TaskState, solver

from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.names import PAPER
from dronecats.bench.harnesses.outside_flight import OutsideFlight
from dronecats.flight.spec.flight_spec import LATENCY, ExternalHarness, FlightSpec, Simulated, latency_policy
from dronecats.judge.episode import verdict_of
from episodes.records import catalogue
from foundation.errors import InfrastructureError, UsageError
from foundation.protocol import CAP_S
from foundation.run_folder.folder import fresh_run
from foundation.run_folder.results import SCORED
from foundation.wording import counted

Effort = Literal["minimal", "low", "medium", "high", "xhigh", "max"]  # values of Inspect's reasoning_effort
FOLDER = "dronecats_folder"  # key of the flight's folder in the sample's store
_DECLARED = ModelSpec(provider="local", name="")  # for its default temperature and max_tokens


@task
def dronecats(
    suite: str | list[str] = "one-drone",
    latency: str = LATENCY,
    seconds: float = CAP_S,
    seed: int = 0,
    axis_order: str = "xy",
    full: bool = False,
    out: str | None = None,
    agent: str = PAPER,
    lifted: Effort | None = None,
) -> Task:
    """Return the task of a suite.

    `suite`: one-drone, commanding, quick, all, or comma-separated ids and files. Inspect splits the text at the commas.

    `latency`: the vehicle time that a reply costs (docs/latency.md). Epoch k flies with the seed `seed` + k - 1.
    `axis_order`: xy or yx, the order of the coordinates in the model's points. `full`: fly to the time limit, even when
    the verdict is decided. `out`: folder that gets a run folder for each model and epoch; None: new run folders in
    `runs`. `agent`: paper, steady or MODULE:NAME. After the reply `think`, which asks for reasoning, the next call
    requests the reasoning effort `lifted`; None: the evaluation's effort. Some models have no such setting.

    Raises UsageError for another `axis_order`, or an effort that Inspect does not know.
    """
    if axis_order not in ("xy", "yx"):
        raise UsageError(f"-T axis_order must be xy or yx, got '{axis_order}'")
    if lifted is not None and lifted not in get_args(Effort):
        raise UsageError(f"-T lifted must be one of {', '.join(get_args(Effort))}, got '{lifted}'")
    title = suite if isinstance(suite, str) else ",".join(suite)
    return Task(
        dataset=MemoryDataset([_sample(id) for id in catalogue.episodes_of(suite)], name=f"dronecats-{title}"),
        solver=flight(latency, seconds, seed, axis_order, full, out, agent, lifted),
        scorer=verdict(),
        config=GenerateConfig(temperature=_DECLARED.temperature, max_tokens=_DECLARED.max_tokens),
        metadata={"latency": latency, "seconds": seconds, "axis_order": axis_order, "agent": agent, "lifted": lifted},
    )


def _sample(name: str) -> Sample:
    record = catalogue.load(name)
    return Sample(
        id=record.id,
        input=record.instruction,
        metadata={"episode": name, "map": record.map, "cell": record.cell, "drones": len(record.starts)},
    )


def _run_name(model: str, epoch: int) -> str:
    return f"{re.sub('[^A-Za-z0-9.]+', '-', model)}-flight{epoch}"


@solver
def flight(
    latency: str,
    seconds: float,
    seed: int,
    axis_order: str,
    full: bool,
    out: str | None,
    agent: str = PAPER,
    lifted: Effort | None = None,
) -> Solver:
    """Fly the sample's episode with the evaluation's model. An infrastructure error is not scored."""
    runs: dict[tuple[str, int], Path] = {}  # by the model and the epoch

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        model = get_model()
        key = str(model), state.epoch
        if key not in runs:
            runs[key] = fresh_run(f"inspect-{model}") if out is None else Path(out) / _run_name(*key)
        spec = FlightSpec(
            episode=str(state.metadata["episode"]),
            simulated=Simulated(speed=None),
            outside=ExternalHarness(
                harness="inspect", name=str(model), axis_order="yx" if axis_order == "yx" else "xy", lifted=lifted
            ),
            agent=agent,
            latency=latency_policy(latency),
            seconds=seconds,
            seed=seed + state.epoch - 1,
            full=full,
        )
        outside = await run_sync(OutsideFlight, spec, runs[key])
        state.store.set(FOLDER, str(outside.folder))
        try:
            while (question := await run_sync(outside.question)) is not None:
                message = ChatMessageUser(content=content(question))
                effort = lifted if question.thinking else None
                output = await model.generate([message], config=GenerateConfig(reasoning_effort=effort))
                if output.error:
                    outside.fail(output.error)
                    continue
                state.messages += [message, output.message]
                state.output = output
                used = output.usage
                tokens = (used.input_tokens, used.output_tokens) if used else ()
                outside.answer(output.completion, *tokens)
        finally:
            with anyio.CancelScope(shield=True):
                await run_sync(outside.close)
        result = outside.result()
        if result.outcome not in SCORED:
            raise InfrastructureError(f"{result.episode} ended in an error and is not scored: {result.error}")
        return state

    return solve


@scorer(metrics=[accuracy(), stderr(), grouped(accuracy(), "cell", all=False), grouped(accuracy(), "map", all=False)])
def verdict() -> Scorer:
    """Judge the flight by Algorithm 1 of the paper, only from the logs in its folder."""

    async def score(state: TaskState, target: Target) -> Score:
        folder = Path(str(state.store.get(FOLDER)))
        judged = await run_sync(verdict_of, folder)
        error = "?" if judged.ne_m is None else f"{judged.ne_m:.2f} m"
        explanation = f"{judged.outcome}: navigation error {error}, {counted(judged.declarations, 'declaration')}"
        metadata = _metadata(judged.as_json(), folder)
        if judged.outcome not in SCORED:  # for example, a limit of Inspect ended the sample
            return Score.unscored(explanation=explanation, metadata=metadata)
        value = CORRECT if judged.outcome == "success" else INCORRECT
        return Score(value=value, explanation=explanation, metadata=metadata)

    return score


def content(question: Request) -> list[Content]:
    """Return a question as Inspect sends it: the text, then each picture after its label."""
    message: list[Content] = [ContentText(text=question.text)]
    for label, jpeg in question.pictures:
        if label is not None:
            message.append(ContentText(text=label))
        message.append(ContentImage(image=f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"))
    return message


def _metadata(verdict_json: dict[str, Any], folder: Path) -> dict[str, Any]:
    kept = ("outcome", "ne_m", "steps", "declarations", "success_at_first", "false_declarations", "diagnostics")
    return {**{name: verdict_json.get(name) for name in kept}, "folder": str(folder)}
