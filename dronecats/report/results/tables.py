"""The SQL tables of runs: their columns with units, and the rows that are made from run folders."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, get_args, get_type_hints

import msgspec
from msgspec import UNSET, Meta

from dronecats.agent.action import Go, Rotate
from dronecats.judge.metrics.judging import METRICS
from dronecats.judge.metrics.metric import Metric, MetricLevel
from dronecats.judge.verdict import declaring_decisions, measured
from dronecats.report.recorded.flight import RecordedFlight, action_of
from dronecats.report.recorded.run import RecordedRun
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder.results import SCORED
from foundation.run_folder.rows import FrameTruth

SQL_TYPES = {bool: "BOOLEAN", int: "BIGINT", float: "DOUBLE", str: "VARCHAR"}


def _of(description: str) -> Meta:
    return Meta(description=description)


RunName = Annotated[str, _of("the end of the run folder's path, long enough to be unique")]
EpisodeId = Annotated[str, _of("id of the episode")]
DroneIndex = Annotated[int, _of("number of the drone, from 0")]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRow:
    """A run folder: its pilot and settings."""

    run: RunName
    pilot: Annotated[str, _of("built-in pilot, or PROVIDER/NAME of the model")]
    is_model: Annotated[bool, _of("whether a model flew, not a built-in pilot")]
    command: Annotated[str | None, _of("flat, hierarchical or solo")]
    latency: Annotated[str | None, _of("latency policy, as in `--latency`")]
    parser: Annotated[str | None, _of("parser of replies: strict or lenient")]
    seed: Annotated[int, _of("distinguishes flights of the same episodes")]
    agent: Annotated[str | None, _of("paper, another built-in agent, or MODULE:NAME")]
    prompt_sha256: Annotated[str | None, _of("digest of the prompt")]
    dronecats: Annotated[str | None, _of("version of dronecats that flew the run")]
    episodes: Annotated[int, _of("number of episodes")]
    configuration: Annotated[str, _of("run.json, as JSON: `configuration->>'$.flight.model.temperature'`")]


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeRow:
    """One flight of one episode: its verdict, computed again from the logs, and every metric of the episode."""

    run: RunName
    episode: EpisodeId
    map: Annotated[str | None, _of("the map's name")]
    cell: Annotated[str | None, _of("approaching, searching, tracking, search-and-track or commanding")]
    instruction: Annotated[str | None, _of("instruction to the pilot")]
    drones: Annotated[int | None, _of("number of drones; null: no drone was logged")]
    outcome: Annotated[
        str | None,
        _of("success, failure, error, censored, unknown or distance only (docs/run-folder.md); null: damaged"),
    ]
    scored: Annotated[bool, _of("whether the outcome is success or failure; other outcomes are not scored")]
    error: Annotated[str | None, _of("why the flight is not scored, or what is damaged; null: it is scored")]
    note: Annotated[str | None, _of("what remains uncertain in the verdict")]
    censored: Annotated[bool | None, _of("whether the flight ended before its cap, so that later steps are unknown")]
    ended: Annotated[
        str | None,
        _of("why it ended: cap, decided (success is certain), budget, rejected, interrupted, takeover or error"),
    ]
    ended_s: Annotated[float | None, _of("s of vehicle time at which the flight ended")]


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRow:
    """One decision of one drone, with the true state at the time of its image."""

    run: RunName
    episode: EpisodeId
    drone_index: DroneIndex
    step: Annotated[int, _of("number of the decision, from 0")]
    frame_id: Annotated[int, _of("number of the image")]
    t_frame_s: Annotated[float, _of("s since the episode began, time of the image")]
    t_decided_s: Annotated[float, _of("s since the episode began, time of the reply")]
    action: Annotated[str | None, _of("go, rotate, think or finished; null: the reply holds no valid action")]
    point_x: Annotated[float | None, _of("point of a go: 0 is the image's left edge, 1000 its right edge")]
    point_y: Annotated[float | None, _of("point of a go: 0 is the image's upper edge, 1000 its lower edge")]
    depth_m: Annotated[float | None, _of("m, depth of a go, as in the reply")]
    angle_deg: Annotated[float | None, _of("°, angle of a rotate, positive to the right, as in the reply")]
    reply: Annotated[str | None, _of("the reply as received")]
    error: Annotated[str | None, _of("why the reply holds no valid action")]
    mended: Annotated[str | None, _of("codes of the repairs of the reply, with commas between them; null: no repair")]
    latency_s: Annotated[float | None, _of("s of vehicle time that the reply took")]
    tokens_in: Annotated[int | None, _of("tokens of the question")]
    tokens_out: Annotated[int | None, _of("tokens of the reply")]
    thinking: Annotated[bool | None, _of("whether extended reasoning was on")]
    rate_hz: Annotated[float | None, _of("Hz, 1 / vehicle time since the previous decision; null: first decision")]
    finish: Annotated[
        str | None, _of("why the reply was cut off or withheld: length, filtered, refusal, …; null: it is complete")
    ]
    north_m: Annotated[float | None, _of("m, NED, position of the drone at the time of the image")]
    east_m: Annotated[float | None, _of("m, NED, position of the drone at the time of the image")]
    down_m: Annotated[float | None, _of("m, NED, position of the drone at the time of the image")]
    yaw_deg: Annotated[float | None, _of("°, heading from north, positive to the east, at the time of the image")]
    distance_m: Annotated[float | None, _of("m, distance to the target's centre, at the time of the image")]
    distance_box_m: Annotated[
        float | None, _of("m, distance to the nearest point of the target's box, at the time of the image")
    ]
    visible: Annotated[bool | None, _of("whether the target was in view; null: not measured")]
    visible_fraction: Annotated[float | None, _of("visible share of the target's silhouette, 0 … 1")]
    bearing_deg: Annotated[float | None, _of("°, angle from the nose to the target's centre, positive to the right")]
    oracle_depth_m: Annotated[
        float | None, _of("m, true depth along the optical axis, median of the target's visible surface")
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseRow:
    """The pose of one drone, every half second."""

    run: RunName
    episode: EpisodeId
    drone_index: DroneIndex
    t_s: Annotated[float, _of("s of vehicle time since the episode began")]
    north_m: Annotated[float, _of("m, NED, position of the drone")]
    east_m: Annotated[float, _of("m, NED, position of the drone")]
    down_m: Annotated[float, _of("m, NED, position of the drone")]
    yaw_deg: Annotated[float | None, _of("°, heading from north, positive to the east")]
    target_north_m: Annotated[float | None, _of("m, NED, position of the target's centre")]
    target_east_m: Annotated[float | None, _of("m, NED, position of the target's centre")]
    target_down_m: Annotated[float | None, _of("m, NED, position of the target's centre")]
    distance_m: Annotated[float | None, _of("m, distance from the drone to the target's centre in three dimensions")]
    visible: Annotated[bool | None, _of("whether the target was in view; null: not measured")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclarationRow:
    """One declaration of arrival, measured as in Algorithm 1 of the paper (docs/glossary.md)."""

    run: RunName
    episode: EpisodeId
    number: Annotated[int, _of("number of the declaration in the episode, in the order of time, from 1")]
    drone_index: DroneIndex
    step: Annotated[int, _of("number of the decision")]
    t_s: Annotated[float, _of("s of vehicle time, time of the decision")]
    counts: Annotated[bool, _of("whether it was made within the cap")]
    distance_m: Annotated[
        float | None,
        _of("m, distance to the target's centre, at the time of the image of its decision; null: not measured"),
    ]
    visible: Annotated[bool | None, _of("whether the target was in view; null: not measured")]
    qualifies: Annotated[bool | None, _of("whether it meets the success rule, apart from the cap; null: not known")]
    unmeasured: Annotated[str | None, _of("why the declaration was not measured; null: it was measured")]


@dataclass(frozen=True, slots=True, kw_only=True)
class SqlColumn:
    name: str
    type: str  # SQL type
    description: str  # begins with the unit, if any


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTable:
    """A table. It has a column for each field of `row`, and for each metric of the level `level`."""

    name: str
    row: type
    level: MetricLevel | None = None  # None: no metric has a column

    @property
    def about(self) -> str:
        """The description of a row, one sentence."""
        return str(self.row.__doc__)

    @property
    def columns(self) -> tuple[SqlColumn, ...]:
        """The columns in their order: the row's fields, then the metrics whose names are not fields."""
        own = [_column(name, hint) for name, hint in get_type_hints(self.row, include_extras=True).items()]
        return (*own, *(_metric_column(metric) for metric in self.metrics))

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The metrics that have a column."""
        taken = get_type_hints(self.row)
        return tuple(m for m in METRICS.values() if m.level == self.level and m.name not in taken)


TABLES: Mapping[str, RunTable] = {
    table.name: table
    for table in (
        RunTable(name="runs", row=RunRow),
        RunTable(name="episodes", row=EpisodeRow, level="episode"),
        RunTable(name="steps", row=StepRow, level="step"),
        RunTable(name="poses", row=PoseRow),
        RunTable(name="declarations", row=DeclarationRow),
    )
}


def markdown() -> str:
    """Return all tables for docs/query.md, without the columns of metrics, which are in docs/metrics.md."""
    return "\n".join(_section(table) for table in TABLES.values())


def _section(table: RunTable) -> str:
    metrics = {metric.name for metric in table.metrics}
    lines = [f"### {table.name}", "", table.about, "", "| column | type | what |", "| --- | --- | --- |"]
    lines += [
        f"| `{c.name}` | {c.type} | {c.description.replace('|', chr(92) + '|')} |"
        for c in table.columns
        if c.name not in metrics
    ]
    return "\n".join([*lines, ""])


def _column(name: str, hint: Any) -> SqlColumn:
    plain, meta = get_args(hint)[:2]
    return SqlColumn(name=name, type=SQL_TYPES[_plain(plain)], description=meta.description)


def _metric_column(metric: Metric) -> SqlColumn:
    unit = {"share": "", "": ""}.get(metric.unit, f"{metric.unit}; ")
    return SqlColumn(name=metric.name, type=SQL_TYPES[metric.value_type], description=f"{unit}{metric.definition}")


def _plain(hint: Any) -> Any:
    return next(part for part in get_args(hint) if part is not type(None)) if isinstance(hint, UnionType) else hint


UNMEASURED = FrameTruth(frame_id=0, t=0.0, drone=0, distance_m=None, visible=None)
Values = dict[str, list[Any]]  # the values of a table, by column name


def names(runs: Sequence[RecordedRun]) -> list[str]:
    """Return a unique name for each run: the shortest end of its folder's path that differs from the others."""
    depth = 1
    while True:
        names = ["/".join(run.folder.resolve().parts[-depth:]) for run in runs]
        if len(set(names)) == len(names) or all(len(run.folder.resolve().parts) <= depth for run in runs):
            return names
        depth += 1


def tabulated(run: RecordedRun, name: str, wanted: Collection[str]) -> tuple[dict[str, Values], list[str]]:
    """Return the rows of a run in the tables `wanted`, and a sentence for each damaged episode.

    A damaged episode does not affect the others. It has one row, in the table `episodes`, with the error.
    """
    tables: dict[str, Values] = {table: {c.name: [] for c in TABLES[table].columns} for table in wanted}
    damaged: list[str] = []
    if "runs" in wanted:
        _append(tables["runs"], _run_row(run, name))
    if set(wanted) <= {"runs"}:
        return tables, damaged
    for folder in run.episodes:
        try:
            flight = RecordedFlight.read(folder)
        except UsageError as damage:
            damaged.append(str(damage))
            if "episodes" in wanted:
                _append(tables["episodes"], _damaged_row(name, folder, str(damage)))
            continue
        for table, rows in EPISODE_TABLES.items():
            if table in wanted:
                for row, metrics in rows(flight, name, TABLES[table]):
                    _append(tables[table], row, metrics)
    return tables, damaged


def _append(values: Values, row: Any, metrics: Mapping[str, Any] | None = None) -> None:
    own = {column_field.name for column_field in fields(row)}
    for column, column_values in values.items():
        column_values.append(getattr(row, column) if column in own else (metrics or {}).get(column))


def _run_row(run: RecordedRun, name: str) -> RunRow:
    configuration, flight = run.configuration, run.flight
    versions = configuration.get("versions")
    return RunRow(
        run=name,
        pilot=run.pilot,
        is_model=run.is_model,
        command=_text(flight.get("command")),
        latency=_text(flight.get("latency")),
        parser=_text(flight.get("parser")),
        seed=run.seed,
        agent=run.agent,
        prompt_sha256=_text(configuration.get("prompt_sha256")),
        dronecats=_text(versions.get("dronecats")) if isinstance(versions, dict) else None,
        episodes=len(run.episodes),
        configuration=msgspec.json.encode(configuration).decode(),
    )


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None


Rows = Iterator[tuple[Any, Mapping[str, Any]]]  # a row, and its metrics


def _episode_rows(flight: RecordedFlight, run: str, table: RunTable) -> Rows:
    verdict, end = flight.verdict, flight.logs.end
    scored = verdict.outcome in SCORED
    row = EpisodeRow(
        run=run,
        episode=flight.id,
        map=flight.map or None,
        cell=flight.cell or None,
        instruction=_text(flight.record.get("instruction")),
        drones=len(verdict.drones) or None,
        outcome=verdict.outcome,
        scored=scored,
        error=None if scored else verdict.error or verdict.outcome,
        note=verdict.note,
        censored=verdict.censored,
        ended=end.reason if end else None,
        ended_s=end.t if end else None,
    )
    yield row, {metric.name: metric.of(flight) for metric in table.metrics}


def _damaged_row(run: str, folder: Path, error: str) -> EpisodeRow:
    nothing: dict[str, Any] = dict.fromkeys(column.name for column in fields(EpisodeRow))
    return EpisodeRow(**{**nothing, "run": run, "episode": folder.resolve().name, "scored": False, "error": error})


def _step_rows(flight: RecordedFlight, run: str, table: RunTable) -> Rows:
    metric_values = {metric.name: metric.of(flight) for metric in table.metrics}
    for number, decision in enumerate(flight.logs.decisions):
        action, frame = action_of(decision), flight.logs.frames.get((decision.drone, decision.frame_id), UNMEASURED)
        north_m, east_m, down_m = frame.position_ned or (None, None, None)
        row = StepRow(
            run=run,
            episode=flight.id,
            drone_index=decision.drone,
            step=decision.step,
            frame_id=decision.frame_id,
            t_frame_s=decision.t_frame,
            t_decided_s=decision.t_decided,
            action=decision.kind,
            point_x=action.x if isinstance(action, Go) else None,
            point_y=action.y if isinstance(action, Go) else None,
            depth_m=action.depth_m if isinstance(action, Go) else None,
            angle_deg=action.angle_deg if isinstance(action, Rotate) else None,
            reply=None if decision.reply is UNSET else decision.reply,
            error=decision.error,
            mended=None if decision.mended is UNSET else ",".join(decision.mended),
            latency_s=decision.latency_s,
            tokens_in=decision.tokens_in,
            tokens_out=decision.tokens_out,
            thinking=decision.thinking,
            rate_hz=decision.rate_hz,
            finish=None if decision.finish is UNSET else decision.finish,
            north_m=north_m,
            east_m=east_m,
            down_m=down_m,
            yaw_deg=frame.yaw_deg,
            distance_m=frame.distance_m,
            distance_box_m=frame.distance_box_m,
            visible=frame.visible,
            visible_fraction=frame.visible_fraction,
            bearing_deg=frame.bearing_deg,
            oracle_depth_m=frame.oracle_depth_m,
        )
        yield row, {name: values[number] for name, values in metric_values.items() if isinstance(values, Sequence)}


def _pose_rows(flight: RecordedFlight, run: str, table: RunTable) -> Rows:
    for pose in flight.logs.poses:
        north_m, east_m, down_m = pose.position_ned
        target_north_m, target_east_m, target_down_m = pose.target_ned or (None, None, None)
        row = PoseRow(
            run=run,
            episode=flight.id,
            drone_index=pose.drone,
            t_s=pose.t,
            north_m=north_m,
            east_m=east_m,
            down_m=down_m,
            yaw_deg=pose.yaw_deg,
            target_north_m=target_north_m,
            target_east_m=target_east_m,
            target_down_m=target_down_m,
            distance_m=pose.distance_m,
            visible=pose.visible,
        )
        yield row, {}


def _declaration_rows(flight: RecordedFlight, run: str, table: RunTable) -> Rows:
    declarations = [measured(decision, flight.logs) for decision in declaring_decisions(flight.logs)]
    for number, declaration in enumerate(sorted(declarations, key=lambda d: (d.t, d.step, d.drone)), 1):
        row = DeclarationRow(
            run=run,
            episode=flight.id,
            number=number,
            drone_index=declaration.drone,
            step=declaration.step,
            t_s=declaration.t,
            counts=declaration.t <= CAP_S,
            distance_m=declaration.distance_m,
            visible=declaration.visible,
            qualifies=declaration.qualifies(flight.delta_m),
            unmeasured=declaration.unknown,
        )
        yield row, {}


EPISODE_TABLES: Mapping[str, Callable[[RecordedFlight, str, RunTable], Rows]] = {
    "episodes": _episode_rows,
    "steps": _step_rows,
    "poses": _pose_rows,
    "declarations": _declaration_rows,
}
