"""`dronecats episodes show ID`: one episode, told and drawn."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.output import show

if TYPE_CHECKING:
    from episodes.records.record import EpisodeRecord


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("show", help="one episode: its map, cell, suites, drones, par and first frame")
    parser.add_argument("episode", metavar="ID", help="an episode's id, or a record's file or folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object, the record included")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write the first frame (.png or .jpg)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the episode and, if asked for, write its first frame."""
    from dronecats.report.table import table_of, words
    from episodes.records import catalogue, suites
    from episodes.records.baselines import load_par

    record = catalogue.load(args.episode)
    member, steps = (suites.of(record.id), load_par().get(record.id)) if catalogue.ships(record) else ((), None)
    if args.picture is not None:
        from episodes.authoring.pictures.first_frame import write_first_frame

        write_first_frame(record, args.picture)
    if args.json:
        summary = {
            "id": record.id,
            "map": record.map,
            "cell": record.cell,
            "suites": list(member),
            "drones": len(record.starts),
            "par": steps,
            "record": json.loads(record.to_json()),
        }
        print(json.dumps(summary, ensure_ascii=False))
        return 0
    show(table_of((words(""), words("")), _lines(record, member, steps)))
    return 0


def _lines(record: "EpisodeRecord", member: tuple[str, ...], steps: int | None) -> list[tuple[str, str]]:
    """Return what there is to tell, name by name."""
    target = record.target
    goal = target.native or f"{target.paint} {target.asset}"
    if target.inscription:
        goal += f" '{target.inscription}' among {len(record.candidates) + 1}"
    if target.path:
        goal += f", moving at {target.path.speed_mps:g} m/s"
    seen = "in sight at the start" if record.visible_at_start else "not in sight at the start"
    return [
        ("id", record.id),
        ("map", f"{record.map}, seed {record.map_seed}"),
        ("cell", record.cell),
        ("suites", ", ".join(member) or "none"),
        ("drones", str(len(record.starts))),
        ("par", f"{steps} steps" if steps else "not flown yet"),
        ("instruction", record.instruction),
        ("target", goal),
        ("start", f"{record.start_distance_m:g} m off, bearing {record.bearing_deg:g}°, {seen}"),
    ]
