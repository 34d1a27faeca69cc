"""The tables that runs are asked in: a dataclass each, a column per field with its unit, and the metrics' columns."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from msgspec import Meta

from dronecats.judge.metrics.metric import Metric, MetricLevel
from dronecats.judge.metrics.registry import METRICS

SQL_TYPES = {bool: "BOOLEAN", int: "BIGINT", float: "DOUBLE", str: "VARCHAR"}


def _of(description: str) -> Meta:
    return Meta(description=description)


RunName = Annotated[str, _of("the run's folder, with as many folders above it as tell it from the others")]
EpisodeId = Annotated[str, _of("id of the record")]
DroneIndex = Annotated[int, _of("0 is the drone that people call drone 1")]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRow:
    """A run folder: who flew, under which settings."""

    run: RunName
    pilot: Annotated[str, _of("built-in pilot, or PROVIDER/NAME of the model")]
    is_model: Annotated[bool, _of("whether a model flew; a built-in pilot is none")]
    command: Annotated[str | None, _of("flat, hierarchical or solo")]
    latency: Annotated[str | None, _of("what a reply is charged, as `--latency` has it")]
    parser: Annotated[str | None, _of("how replies are read: strict or lenient")]
    seed: Annotated[int, _of("tells flights of the same episodes apart")]
    agent: Annotated[str | None, _of("who decides: paper, another that ships, or MODULE:NAME")]
    prompt_sha256: Annotated[str | None, _of("digest of the prompt")]
    dronecats: Annotated[str | None, _of("version that flew it")]
    episodes: Annotated[int, _of("how many stand in it")]
    configuration: Annotated[str, _of("run.json, as JSON: `configuration->>'$.flight.model.temperature'`")]


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeRow:
    """One flight of one episode: its verdict, derived anew from the logs, and every metric of the whole episode."""

    run: RunName
    episode: EpisodeId
    map: Annotated[str | None, _of("the map's name")]
    cell: Annotated[str | None, _of("approaching, searching, tracking, search-and-track or commanding")]
    instruction: Annotated[str | None, _of("what was asked for")]
    drones: Annotated[int | None, _of("how many flew; null: nothing was logged of any")]
    outcome: Annotated[str | None, _of("success, failure, error, censored, unknown or distance only; null: damaged")]
    scored: Annotated[bool, _of("whether it is a success or a failure; the others are nobody's score")]
    error: Annotated[str | None, _of("why it is nobody's score, or what is damaged; null: it is scored")]
    note: Annotated[str | None, _of("what the verdict leaves open though it stands")]
    censored: Annotated[bool | None, _of("whether the flight was not seen to its cap though its outcome stands")]
    ended: Annotated[str | None, _of("cap, decided, budget, rejected, interrupted, takeover or error")]
    ended_s: Annotated[float | None, _of("s of vehicle time")]


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRow:
    """One decision of one drone, with what was true when its picture was taken."""

    run: RunName
    episode: EpisodeId
    drone_index: DroneIndex
    step: Annotated[int, _of("number of the decision, from 0")]
    frame_id: Annotated[int, _of("number of the picture")]
    t_frame_s: Annotated[float, _of("s since the episode began, when the picture was taken")]
    t_decided_s: Annotated[float, _of("s, when the reply was there")]
    action: Annotated[str | None, _of("go, rotate, think or finished; null: the reply holds no valid action")]
    point_x: Annotated[float | None, _of("of a go: 0 the picture's left edge, 1000 its right one")]
    point_y: Annotated[float | None, _of("of a go: 0 the picture's upper edge, 1000 its lower one")]
    depth_m: Annotated[float | None, _of("m, of a go, as the pilot told it")]
    angle_deg: Annotated[float | None, _of("°, of a rotate, + right, as the pilot told it")]
    reply: Annotated[str | None, _of("as received")]
    error: Annotated[str | None, _of("why there is no action")]
    mended: Annotated[str | None, _of("what was mended in the reply, codes with commas between them; null: nothing")]
    latency_s: Annotated[float | None, _of("s of vehicle time that the reply took")]
    tokens_in: Annotated[int | None, _of("tokens of the question")]
    tokens_out: Annotated[int | None, _of("tokens of the reply")]
    thinking: Annotated[bool | None, _of("whether the model was let to reason at length")]
    rate_hz: Annotated[float | None, _of("Hz, decisions per s of vehicle time since the last; null: the first")]
    finish: Annotated[str | None, _of("why the reply ends: length, filtered, refusal, …; null: it was done")]
    north_m: Annotated[float | None, _of("m, NED, of the body at the picture")]
    east_m: Annotated[float | None, _of("m, NED, likewise")]
    down_m: Annotated[float | None, _of("m, NED, likewise")]
    yaw_deg: Annotated[float | None, _of("° of the nose from north, + east, at the picture")]
    distance_m: Annotated[float | None, _of("m to the target's centre, at the picture")]
    distance_box_m: Annotated[float | None, _of("m to the nearest point of the target's box, at the picture")]
    visible: Annotated[bool | None, _of("whether the target was in view; null: nobody measured it")]
    visible_fraction: Annotated[float | None, _of("share of the target's silhouette that is open to view, 0 … 1")]
    bearing_deg: Annotated[float | None, _of("° of the target's centre from the nose, + right")]
    oracle_depth_m: Annotated[float | None, _of("m along the optical axis, to the target's centre")]


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseRow:
    """Where one drone was, every half second."""

    run: RunName
    episode: EpisodeId
    drone_index: DroneIndex
    t_s: Annotated[float, _of("s of vehicle time since the episode began")]
    north_m: Annotated[float, _of("m, NED, of the body")]
    east_m: Annotated[float, _of("m, NED, likewise")]
    down_m: Annotated[float, _of("m, NED, likewise")]
    yaw_deg: Annotated[float | None, _of("° of the nose from north, + east")]
    target_north_m: Annotated[float | None, _of("m, NED, of the target's centre")]
    target_east_m: Annotated[float | None, _of("m, NED, likewise")]
    target_down_m: Annotated[float | None, _of("m, NED, likewise")]
    distance_m: Annotated[float | None, _of("m, body to the target's centre in three dimensions")]
    visible: Annotated[bool | None, _of("whether the target was in view; null: nobody measured it")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclarationRow:
    """One declaration of arrival, as Algorithm 1 takes it."""

    run: RunName
    episode: EpisodeId
    number: Annotated[int, _of("of the episode's declarations in the order of time, from 1")]
    drone_index: DroneIndex
    step: Annotated[int, _of("number of the decision")]
    t_s: Annotated[float, _of("s of vehicle time, when it was decided")]
    counts: Annotated[bool, _of("whether it was made within the cap")]
    distance_m: Annotated[float | None, _of("m to the target's centre, at its own picture; null: not measured")]
    visible: Annotated[bool | None, _of("whether the target was in view; null: not measured")]
    qualifies: Annotated[bool | None, _of("whether it is a success, if it counts; null: not known")]
    unmeasured: Annotated[str | None, _of("why it was not measured; null: it was")]


@dataclass(frozen=True, slots=True, kw_only=True)
class SqlColumn:
    """A column as it is told to people and to the database."""

    name: str
    type: str  # of SQL
    description: str  # its unit first, where it has one


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTable:
    """A table: a row's class, and of which metrics it has a column each."""

    name: str
    row: type
    level: MetricLevel | None = None  # of the metrics

    @property
    def about(self) -> str:
        """What a row is, one sentence."""
        return str(self.row.__doc__)

    @property
    def columns(self) -> tuple[SqlColumn, ...]:
        """Its columns in their order: the row's fields, then the metrics that no field has the name of."""
        own = [_column(name, hint) for name, hint in get_type_hints(self.row, include_extras=True).items()]
        return (*own, *(_metric_column(metric) for metric in self.metrics))

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The metrics that it has columns of."""
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
    """Return all tables with their columns as docs/query.md has them."""
    return "\n".join(_section(table) for table in TABLES.values())


def _section(table: RunTable) -> str:
    lines = [f"### {table.name}", "", table.about, "", "| column | type | what |", "| --- | --- | --- |"]
    lines += [f"| `{c.name}` | {c.type} | {c.description.replace('|', chr(92) + '|')} |" for c in table.columns]
    return "\n".join([*lines, ""])


def _column(name: str, hint: Any) -> SqlColumn:
    plain, meta = get_args(hint)[:2]
    return SqlColumn(name=name, type=SQL_TYPES[_plain(plain)], description=meta.description)


def _metric_column(metric: Metric) -> SqlColumn:
    unit = {"share": "", "": ""}.get(metric.unit, f"{metric.unit}; ")
    return SqlColumn(name=metric.name, type=_measured_type(metric), description=f"{unit}{metric.definition}")


def _measured_type(metric: Metric) -> str:
    """Return the type of what a metric's function says that it returns: DOUBLE unless that is narrower."""
    hint = get_type_hints(metric.of).get("return")
    kinds = {k for k in _leaves(hint) if k is not type(None)}
    return SQL_TYPES[kinds.pop()] if len(kinds) == 1 and kinds <= SQL_TYPES.keys() else SQL_TYPES[float]


def _leaves(hint: Any) -> set[Any]:
    """Return the types that an annotation is made of, those within a sequence likewise."""
    if get_origin(hint) is Annotated:
        return _leaves(get_args(hint)[0])
    inner = [each for each in get_args(hint) if each is not Ellipsis]
    return set().union(*map(_leaves, inner)) if inner else {hint}


def _plain(hint: Any) -> type:
    if isinstance(hint, UnionType):
        hint = next(each for each in get_args(hint) if each is not type(None))
    found: type = hint
    return found
