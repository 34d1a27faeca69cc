"""The SQL tables of runs: their columns with units, and the values of the columns that are read from run folders."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec
from msgspec import UNSET

from dronecats.agent.action import Action, Go, Rotate
from dronecats.judge.metrics.judging import METRICS
from dronecats.judge.metrics.metric import Metric, MetricLevel
from dronecats.judge.verdict import Measured, in_order
from dronecats.report.recorded.flight import RecordedFlight, action_of
from dronecats.report.recorded.run import RecordedRun
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder.rows import Decision, FrameTruth, Pose

SQL_TYPES = {bool: "BOOLEAN", int: "BIGINT", float: "DOUBLE"}  # type of a metric's value → SQL type
Item = TypeVar("Item")


class Step(NamedTuple):
    """One decision of one drone, with the true state at the time of its image."""

    decision: Decision
    action: Action | None
    truth: FrameTruth


class NumberedDeclaration(NamedTuple):
    """One declaration of arrival, measured as in Algorithm 1 of the paper (docs/glossary.md)."""

    number: int
    measured: Measured


@dataclass(frozen=True, slots=True)
class SqlColumn(Generic[Item]):
    name: str
    type: str  # SQL type
    description: str  # begins with the unit, if any
    value: Callable[[Item], Any] | None = None  # returns the value of an item; None: its attribute with this name

    def of(self, items: Iterable[Item]) -> list[Any]:
        """Return the values of items; None for unknown values."""
        values = (getattr(item, self.name) if self.value is None else self.value(item) for item in items)
        return [None if value is UNSET else value for value in values]


@dataclass(frozen=True, slots=True)
class RunTable(Generic[Item]):
    """A table with a row per item. It has the columns `own`, and a column for each metric of the level `level`."""

    name: str
    about: str  # description of a row, one sentence
    items: Callable[[Any], Sequence[Item]]  # returns the items of a flight; for the table `runs`, of a run
    own: tuple[SqlColumn[Item], ...]
    level: MetricLevel | None = None  # None: no metric has a column

    @property
    def columns(self) -> tuple[SqlColumn[Item], ...]:
        """The table's own columns, then one column for each metric whose name is not among them."""
        return (*self.own, *(_metric_column(metric) for metric in self.metrics))

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The metrics that have a column."""
        taken = {column.name for column in self.own}
        return tuple(m for m in METRICS.values() if m.level == self.level and m.name not in taken)


def _metric_column(metric: Metric) -> SqlColumn[Any]:
    unit = {"share": "", "": ""}.get(metric.unit, f"{metric.unit}; ")
    return SqlColumn(metric.name, SQL_TYPES[metric.value_type], f"{unit}{metric.definition}")


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None


def _version(run: RecordedRun) -> str | None:
    versions = run.configuration.get("versions")
    return _text(versions.get("dronecats")) if isinstance(versions, dict) else None


def _error(flight: RecordedFlight) -> str | None:
    return None if flight.scored else flight.verdict.error or flight.verdict.outcome


def _axis(place: Sequence[float] | None, axis: int) -> float | None:
    return None if place is None else place[axis]


def _steps(flight: RecordedFlight) -> list[Step]:
    frames = flight.logs.frames
    return [Step(d, action_of(d), frames.get((d.drone, d.frame_id), UNMEASURED)) for d in flight.logs.decisions]


def _declarations(flight: RecordedFlight) -> list[NumberedDeclaration]:
    return [NumberedDeclaration(k, d) for k, d in enumerate(in_order(flight.all_declarations, float("inf")), 1)]


UNMEASURED = FrameTruth(frame_id=0, t=0.0, drone=0, distance_m=None, visible=None)
RUN: SqlColumn[Any] = SqlColumn("run", "VARCHAR", "the end of the run folder's path, long enough to be unique")
EPISODE: SqlColumn[Any] = SqlColumn("episode", "VARCHAR", "id of the episode")
DRONE_INDEX = "drone_index", "BIGINT", "number of the drone, from 0"
AT_IMAGE = "m, NED, position of the drone at the time of the image"
POSITION, TARGET = "m, NED, position of the drone", "m, NED, position of the target's centre"
VISIBLE = "visible", "BOOLEAN", "whether the target was in view; null: not measured"
RUN_COLUMNS: tuple[SqlColumn[RecordedRun], ...] = (
    RUN,
    SqlColumn("pilot", "VARCHAR", "built-in pilot, or PROVIDER/NAME of the model"),
    SqlColumn("is_model", "BOOLEAN", "whether a model flew, not a built-in pilot"),
    SqlColumn("command", "VARCHAR", "flat, hierarchical or solo", lambda run: _text(run.flight.get("command"))),
    SqlColumn("latency", "VARCHAR", "latency policy, as in `--latency`", lambda run: _text(run.flight.get("latency"))),
    SqlColumn("parser", "VARCHAR", "parser of replies: strict or lenient", lambda run: _text(run.flight.get("parser"))),
    SqlColumn("seed", "BIGINT", "distinguishes flights of the same episodes"),
    SqlColumn("agent", "VARCHAR", "`paper`, another built-in agent, or MODULE:NAME"),
    SqlColumn("prompt_sha256", "VARCHAR", "digest of the prompt",
              lambda run: _text(run.configuration.get("prompt_sha256"))),
    SqlColumn("dronecats", "VARCHAR", "version of dronecats that flew the run", _version),
    SqlColumn("episodes", "BIGINT", "number of episodes", lambda run: len(run.episodes)),
    SqlColumn("configuration", "VARCHAR", "run.json, as JSON: `configuration->>'$.flight.model.temperature'`",
              lambda run: msgspec.json.encode(run.configuration).decode()),
)  # fmt: skip
EPISODE_COLUMNS: tuple[SqlColumn[RecordedFlight], ...] = (
    RUN,
    EPISODE,
    SqlColumn("map", "VARCHAR", "the map's name", lambda flight: flight.map or None),
    SqlColumn("cell", "VARCHAR", "approaching, searching, tracking, search-and-track or commanding",
              lambda flight: flight.cell or None),
    SqlColumn("instruction", "VARCHAR", "instruction to the pilot",
              lambda flight: _text(flight.record.get("instruction"))),
    SqlColumn("drones", "BIGINT", "number of drones; null: no drone was logged",
              lambda flight: len(flight.verdict.drones) or None),
    SqlColumn("outcome", "VARCHAR",
              "success, failure, error, censored, unknown or distance only (docs/run-folder.md); null: damaged",
              lambda flight: flight.verdict.outcome),
    SqlColumn("scored", "BOOLEAN", "whether the outcome is success or failure; other outcomes are not scored"),
    SqlColumn("error", "VARCHAR", "why the flight is not scored, or what is damaged; null: it is scored", _error),
    SqlColumn("note", "VARCHAR", "what remains uncertain in the verdict", lambda flight: flight.verdict.note),
    SqlColumn("censored", "BOOLEAN", "whether the flight ended before its cap, so a longer one might end otherwise",
              lambda flight: flight.verdict.censored),
    SqlColumn("ended", "VARCHAR",
              "why it ended: cap, decided (success is certain), budget, rejected, interrupted, takeover or error",
              lambda flight: flight.logs.end and flight.logs.end.reason),
    SqlColumn("ended_s", "DOUBLE", "s of vehicle time at which the flight ended",
              lambda flight: flight.logs.end and flight.logs.end.t),
)  # fmt: skip
STEP_COLUMNS: tuple[SqlColumn[Step], ...] = (
    RUN,
    EPISODE,
    SqlColumn(*DRONE_INDEX, lambda step: step.decision.drone),
    SqlColumn("step", "BIGINT", "number of the decision, from 0", lambda step: step.decision.step),
    SqlColumn("frame_id", "BIGINT", "number of the image", lambda step: step.decision.frame_id),
    SqlColumn("t_frame_s", "DOUBLE", "s since the episode began, time of the image",
              lambda step: step.decision.t_frame),
    SqlColumn("t_decided_s", "DOUBLE", "s since the episode began, time of the reply",
              lambda step: step.decision.t_decided),
    SqlColumn("action", "VARCHAR", "go, rotate, think or finished; null: the reply holds no valid action",
              lambda step: step.decision.kind),
    SqlColumn("point_x", "DOUBLE", "point of a go: 0 is the image's left edge, 1000 its right edge",
              lambda step: step.action.x if isinstance(step.action, Go) else None),
    SqlColumn("point_y", "DOUBLE", "point of a go: 0 is the image's upper edge, 1000 its lower edge",
              lambda step: step.action.y if isinstance(step.action, Go) else None),
    SqlColumn("depth_m", "DOUBLE", "m, depth of a go, as in the reply",
              lambda step: step.action.depth_m if isinstance(step.action, Go) else None),
    SqlColumn("angle_deg", "DOUBLE", "°, angle of a rotate, positive to the right, as in the reply",
              lambda step: step.action.angle_deg if isinstance(step.action, Rotate) else None),
    SqlColumn("reply", "VARCHAR", "the reply as received", lambda step: step.decision.reply),
    SqlColumn("error", "VARCHAR", "why the reply holds no valid action", lambda step: step.decision.error),
    SqlColumn("mended", "VARCHAR", "codes of the repairs of the reply, with commas between them; null: no repair",
              lambda step: UNSET if step.decision.mended is UNSET else ",".join(step.decision.mended)),
    SqlColumn("thinking", "BOOLEAN", "whether extended reasoning was on", lambda step: step.decision.thinking),
    SqlColumn("finish", "VARCHAR",
              "why the reply was cut off or withheld: length, filtered, refusal, …; null: it is complete",
              lambda step: step.decision.finish),
    SqlColumn("north_m", "DOUBLE", AT_IMAGE, lambda step: _axis(step.truth.position_ned, 0)),
    SqlColumn("east_m", "DOUBLE", AT_IMAGE, lambda step: _axis(step.truth.position_ned, 1)),
    SqlColumn("down_m", "DOUBLE", AT_IMAGE, lambda step: _axis(step.truth.position_ned, 2)),
    SqlColumn("yaw_deg", "DOUBLE", "°, heading from north, positive to the east, at the time of the image",
              lambda step: step.truth.yaw_deg),
    SqlColumn("distance_m", "DOUBLE", "m, distance to the target's centre, at the time of the image",
              lambda step: step.truth.distance_m),
    SqlColumn("distance_box_m", "DOUBLE",
              "m, distance to the nearest point of the target's box, at the time of the image",
              lambda step: step.truth.distance_box_m),
    SqlColumn(*VISIBLE, lambda step: step.truth.visible),
    SqlColumn("visible_fraction", "DOUBLE", "visible share of the target's silhouette, 0 … 1",
              lambda step: step.truth.visible_fraction),
    SqlColumn("bearing_deg", "DOUBLE", "°, angle from the nose to the target's centre, positive to the right",
              lambda step: step.truth.bearing_deg),
    SqlColumn("oracle_depth_m", "DOUBLE",
              "m, true depth along the optical axis, median of the target's visible surface",
              lambda step: step.truth.oracle_depth_m),
)  # fmt: skip
POSE_COLUMNS: tuple[SqlColumn[Pose], ...] = (
    RUN,
    EPISODE,
    SqlColumn(*DRONE_INDEX, lambda pose: pose.drone),
    SqlColumn("t_s", "DOUBLE", "s of vehicle time since the episode began", lambda pose: pose.t),
    SqlColumn("north_m", "DOUBLE", POSITION, lambda pose: pose.position_ned[0]),
    SqlColumn("east_m", "DOUBLE", POSITION, lambda pose: pose.position_ned[1]),
    SqlColumn("down_m", "DOUBLE", POSITION, lambda pose: pose.position_ned[2]),
    SqlColumn("yaw_deg", "DOUBLE", "°, heading from north, positive to the east"),
    SqlColumn("target_north_m", "DOUBLE", TARGET, lambda pose: _axis(pose.target_ned, 0)),
    SqlColumn("target_east_m", "DOUBLE", TARGET, lambda pose: _axis(pose.target_ned, 1)),
    SqlColumn("target_down_m", "DOUBLE", TARGET, lambda pose: _axis(pose.target_ned, 2)),
    SqlColumn("distance_m", "DOUBLE", "m, distance from the drone to the target's centre in three dimensions"),
    SqlColumn(*VISIBLE),
)
DECLARATION_COLUMNS: tuple[SqlColumn[NumberedDeclaration], ...] = (
    RUN,
    EPISODE,
    SqlColumn("number", "BIGINT", "number of the declaration in the episode, in the order of time, from 1"),
    SqlColumn(*DRONE_INDEX, lambda declaration: declaration.measured.drone),
    SqlColumn("step", "BIGINT", "number of the decision", lambda declaration: declaration.measured.step),
    SqlColumn("t_s", "DOUBLE", "s of vehicle time, time of the decision", lambda declaration: declaration.measured.t),
    SqlColumn("counts", "BOOLEAN", "whether it was made within the cap",
              lambda declaration: declaration.measured.t <= CAP_S),
    SqlColumn("distance_m", "DOUBLE",
              "m, distance to the target's centre when the decision's image was taken; null: not measured",
              lambda declaration: declaration.measured.distance_m),
    SqlColumn(*VISIBLE, lambda declaration: declaration.measured.visible),
    SqlColumn("qualifies", "BOOLEAN", "whether it meets the success rule, apart from the cap; null: not known",
              lambda declaration: declaration.measured.qualifies()),
    SqlColumn("unmeasured", "VARCHAR", "why the declaration was not measured; null: it was measured",
              lambda declaration: declaration.measured.unknown),
)  # fmt: skip
TABLES: Mapping[str, RunTable[Any]] = {
    table.name: table
    for table in (
        RunTable("runs", "A run folder: its pilot and settings.", lambda run: [run], RUN_COLUMNS),
        RunTable(
            "episodes",
            "One flight of one episode: its verdict, computed again from the logs, and every metric of the episode.",
            lambda flight: [flight],
            EPISODE_COLUMNS,
            level="episode",
        ),
        RunTable(
            "steps",
            "One decision of one drone, with the true state at the time of its image.",
            _steps,
            STEP_COLUMNS,
            level="step",
        ),
        RunTable("poses", "The pose of one drone, every half second.", lambda flight: flight.logs.poses, POSE_COLUMNS),
        RunTable(
            "declarations",
            "One declaration of arrival, measured as in Algorithm 1 of the paper (docs/glossary.md).",
            _declarations,
            DECLARATION_COLUMNS,
        ),
    )
}


def markdown() -> str:
    """Return all tables for docs/query.md, without the columns of metrics, which are in docs/metrics.md."""
    return "\n".join(_section(table) for table in TABLES.values())


def _section(table: RunTable[Any]) -> str:
    lines = [f"### {table.name}", "", table.about, "", "| column | type | what |", "| --- | --- | --- |"]
    lines += [f"| `{c.name}` | {c.type} | {c.description.replace('|', chr(92) + '|')} |" for c in table.own]
    return "\n".join([*lines, ""])


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
        _add(tables["runs"], TABLES["runs"], run, run=name)
    if set(wanted) <= {"runs"}:
        return tables, damaged
    for folder in run.episodes:
        try:
            flight = RecordedFlight.read(folder)
        except UsageError as damage:
            damaged.append(str(damage))
            known = {"run": name, "episode": folder.resolve().name, "scored": False, "error": str(damage)}
            for column, values in tables.get("episodes", {}).items():
                values.append(known.get(column))
            continue
        for table in wanted:
            if table != "runs":
                _add(tables[table], TABLES[table], flight, run=name, episode=flight.id)
    return tables, damaged


def _add(values: Values, table: RunTable[Any], source: Any, **keys: str) -> None:
    """Add the rows of a run or a flight, the source, to a table. `keys`: values that are equal in these rows."""
    items = table.items(source)
    for key, value in keys.items():
        values[key] += [value] * len(items)
    for column in table.own[len(keys) :]:  # the keys are the first columns
        values[column.name] += column.of(items)
    for metric in table.metrics:
        measured = metric.of(source)
        values[metric.name] += measured if isinstance(measured, Sequence) else [measured]
