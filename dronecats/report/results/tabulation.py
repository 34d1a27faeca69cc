"""From run folders to the rows of the tables. Only what a table needs is read; what is damaged is told."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET

from dronecats.agent.action import Action, ActionError, Go, Rotate, action_from
from dronecats.judge.verdict import finished, measured
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.tables import TABLES, DeclarationRow, EpisodeRow, PoseRow, RunRow, RunTable, StepRow
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder.results import SCORED
from foundation.run_folder.rows import Decision, FrameTruth

UNMEASURED = FrameTruth(frame_id=0, t=0.0, drone=0, distance_m=None, visible=None)
Values = dict[str, list[Any]]  # of a table, by the names of its columns


@dataclass(slots=True)
class Tabulated:
    """The rows of one run, a list per column of each table that was asked for."""

    tables: dict[str, Values] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)  # what is damaged, a sentence an episode


def names(runs: Sequence[RecordedRun]) -> list[str]:
    """Return a name for each run: the end of its folder's path that no other of them ends with."""
    depth = 1
    while True:
        told = ["/".join(run.folder.resolve().parts[-depth:]) for run in runs]
        if len(set(told)) == len(told) or all(len(run.folder.resolve().parts) <= depth for run in runs):
            return told
        depth += 1


def tabulated(run: RecordedRun, name: str, wanted: Collection[str]) -> Tabulated:
    """Return the rows that a run has in the tables `wanted`. One damaged episode spoils no other.

    Of a damaged one there is a row in `episodes`, with its error, and none elsewhere.
    """
    made = Tabulated({table: {c.name: [] for c in TABLES[table].columns} for table in wanted})
    if "runs" in wanted:
        _append(made.tables["runs"], _run_row(run, name))
    if set(wanted) <= {"runs"}:
        return made
    for folder in run.episodes:
        try:
            flown = RecordedFlight.read(folder)
        except UsageError as damage:
            made.damage.append(str(damage))
            if "episodes" in wanted:
                _append(made.tables["episodes"], _damaged_row(name, folder, str(damage)))
            continue
        for table, rows in OF_EPISODE.items():
            if table in wanted:
                for row, metrics in rows(flown, name, TABLES[table]):
                    _append(made.tables[table], row, metrics)
    return made


def _append(values: Values, row: Any, metrics: Mapping[str, Any] | None = None) -> None:
    own = {each.name for each in fields(row)}
    for column, told in values.items():
        told.append(getattr(row, column) if column in own else (metrics or {}).get(column))


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


def _episode_rows(flown: RecordedFlight, run: str, table: RunTable) -> Rows:
    verdict, end = flown.verdict, flown.logs.end
    scored = verdict.outcome in SCORED
    row = EpisodeRow(
        run=run,
        episode=flown.id,
        map=flown.map or None,
        cell=flown.cell or None,
        instruction=_text(flown.record.get("instruction")),
        drones=len(verdict.drones) or None,
        outcome=verdict.outcome,
        scored=scored,
        error=None if scored else verdict.error or verdict.outcome,
        note=verdict.note,
        censored=verdict.censored,
        ended=end.reason if end else None,
        ended_s=end.t if end else None,
    )
    yield row, {metric.name: metric.of(flown) for metric in table.metrics}


def _damaged_row(run: str, folder: Path, error: str) -> EpisodeRow:
    nothing: dict[str, Any] = dict.fromkeys(each.name for each in fields(EpisodeRow))
    return EpisodeRow(**{**nothing, "run": run, "episode": folder.resolve().name, "scored": False, "error": error})


def _step_rows(flown: RecordedFlight, run: str, table: RunTable) -> Rows:
    told = {metric.name: metric.of(flown) for metric in table.metrics}
    for number, said in enumerate(flown.logs.decisions):
        action, frame = _action(said), flown.logs.frames.get((said.drone, said.frame_id), UNMEASURED)
        north_m, east_m, down_m = frame.position_ned or (None, None, None)
        row = StepRow(
            run=run,
            episode=flown.id,
            drone_index=said.drone,
            step=said.step,
            frame_id=said.frame_id,
            t_frame_s=said.t_frame,
            t_decided_s=said.t_decided,
            action=said.kind,
            point_x=action.x if isinstance(action, Go) else None,
            point_y=action.y if isinstance(action, Go) else None,
            depth_m=action.depth_m if isinstance(action, Go) else None,
            angle_deg=action.angle_deg if isinstance(action, Rotate) else None,
            reply=None if said.reply is UNSET else said.reply,
            error=said.error,
            mended=None if said.mended is UNSET else ",".join(said.mended),
            latency_s=said.latency_s,
            tokens_in=said.tokens_in,
            tokens_out=said.tokens_out,
            thinking=said.thinking,
            rate_hz=said.rate_hz,
            finish=None if said.finish is UNSET else said.finish,
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
        yield row, {name: values[number] for name, values in told.items() if isinstance(values, Sequence)}


def _action(said: Decision) -> Action | None:
    """Return the action that was taken; None where there was none, or the log holds one that nobody can take."""
    try:
        return action_from(said.action)
    except ActionError:
        return None


def _pose_rows(flown: RecordedFlight, run: str, table: RunTable) -> Rows:
    for pose in flown.logs.poses:
        north_m, east_m, down_m = pose.position_ned
        target_north_m, target_east_m, target_down_m = pose.target_ned or (None, None, None)
        row = PoseRow(
            run=run,
            episode=flown.id,
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


def _declaration_rows(flown: RecordedFlight, run: str, table: RunTable) -> Rows:
    told = [measured(decision, flown.logs) for decision in finished(flown.logs)]
    for number, one in enumerate(sorted(told, key=lambda d: (d.t, d.step, d.drone)), 1):
        row = DeclarationRow(
            run=run,
            episode=flown.id,
            number=number,
            drone_index=one.drone,
            step=one.step,
            t_s=one.t,
            counts=one.t <= CAP_S,
            distance_m=one.distance_m,
            visible=one.visible,
            qualifies=one.qualifies(flown.delta_m),
            unmeasured=one.unknown,
        )
        yield row, {}


OF_EPISODE: Mapping[str, Callable[[RecordedFlight, str, RunTable], Rows]] = {
    "episodes": _episode_rows,
    "steps": _step_rows,
    "poses": _pose_rows,
    "declarations": _declaration_rows,
}
