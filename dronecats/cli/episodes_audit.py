"""Action `episodes audit`: flies episodes with a built-in pilot, to check that they can be solved."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.cli.next_commands import print_next
from dronecats.cli.output import print_note, progress_bar, show
from foundation.errors import UsageError
from foundation.files import write_json
from foundation.machine import cores
from foundation.run_folder.folder import fresh_run
from foundation.run_folder.reading import stored_result
from foundation.run_folder.results import Result
from foundation.wording import printable

LOG_PERIOD_S = 30.0  # s between two progress lines in a log

if TYPE_CHECKING:
    from dronecats.bench.campaign import EndedFlight
    from dronecats.flight.spec.flight_spec import FlightSpec
    from episodes.records.catalogue import BlindFlight


def add_audit_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("episodes", nargs="*", metavar="ID|FILE", help="only these (default: all shipped)")
    parser.add_argument("--suite", metavar="NAME", help="one-drone, commanding, quick, all or v1")
    parser.add_argument(
        "--pilot", default="oracle", metavar="NAME", help="oracle (default), vision, blind:NAME or failing:NAME"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the sensors' noise (default 0)")
    parser.add_argument(
        "--latency", default="fixed:0.1", metavar="POLICY", help="fixed:SECONDS of vehicle time (default fixed:0.1)"
    )
    parser.add_argument("--rendered", action="store_true", help="also render frames for pilots that do not use them")
    parser.add_argument("--jobs", type=int, metavar="N", help="flights at a time (default: one per core)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="run folder; an unfinished one is resumed")
    parser.add_argument(
        "--write-par", action="store_true", help="write the oracle's steps to episodes/records/par.json"
    )
    parser.add_argument(
        "--write-blind", action="store_true", help="write a blind pilot's results to episodes/records/blind.json"
    )
    parser.add_argument("--json", action="store_true", help="end with one JSON object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fly the episodes. Return 1 if the oracle failed an episode, 3 if a flight ended in an error, else 0."""
    from dronecats.bench.campaign import Batch, fly_run
    from dronecats.bench.matrix import choose_suite
    from dronecats.bench.tables import audit_table, blind_flights, floor, groups, score_row, solved_steps
    from dronecats.flight.run.fly import settings
    from dronecats.flight.spec.flight import look_up
    from episodes.records.catalogue import load_blind

    interrupt_on_signals()
    if args.jobs is not None and not 1 <= args.jobs <= 64:
        raise UsageError(f"--jobs must be 1 to 64, got {args.jobs}")
    if args.write_par and args.pilot != "oracle":
        raise UsageError("--write-par works with the pilot oracle only. Leave --pilot out")
    if args.write_blind and not args.pilot.startswith("blind:"):
        raise UsageError("--write-blind works with blind pilots only. Add --pilot blind:NAME")
    chosen = tuple(
        choose_suite(args.episodes, [args.suite] if args.suite else [] if args.episodes else ["all"]).records
    )
    spec = _flight(args)
    flight = look_up(spec)
    batch = Batch(args.out or fresh_run(f"audit-{args.pilot}"), settings(flight, flight.camera))
    results = [stored_result(batch.folder(e).name, batch.folder(e)) for e in chosen if batch.done(e) is not None]
    bar = progress_bar(len(chosen), len(results), "episode", LOG_PERIOD_S)

    def ended(came: "EndedFlight") -> None:
        result = came.result
        if result.outcome != "success":
            bar.write(printable(f"{result.episode}: {result.outcome}{_reason(result)}"), file=bar.fp)
        bar.update()

    try:
        results += fly_run(batch, spec, chosen, args.jobs or cores(), ended)
    except KeyboardInterrupt:
        print_note(f"\ninterrupted. To resume, add --out {batch.run}")
        raise
    finally:
        bar.close()
    lines = groups(results)
    rows = [score_row(name, members) for name, members in lines.items()]
    if args.write_par:
        _keep(solved_steps(results))
    if args.write_blind:
        _keep_blind(args.pilot, blind_flights(results))
    floors = {name: floor(load_blind(), name, members) for name, members in lines.items()}
    if args.json:
        unsolved = {r.episode: r.outcome for r in results if r.outcome != "success"}
        report = {"pilot": args.pilot, "run_dir": str(batch.run), "rows": [asdict(r) for r in rows]}
        report["blind"] = [
            {"pilot": pilot, "best_by": kind, **asdict(row)}
            for below in floors.values()
            if below
            for kind, (pilot, row) in (("solved", below.solved), ("solved_within_three", below.within_three))
        ]
        print(json.dumps({**report, "unsolved": unsolved}))
    else:
        show(audit_table(rows, floors))
        print(f"run folder: {batch.run}")
        print_next("episodes audit", run=batch.run)
    if rows[-1].errors:
        return 3
    return 1 if args.pilot == "oracle" and rows[-1].solved < rows[-1].flown else 0


def _flight(args: argparse.Namespace) -> "FlightSpec":
    """Return the specification of the run's flights, without the episode."""
    from dronecats.agent.latency import LatencyPolicy
    from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
    from dronecats.pilots import roster

    return FlightSpec(
        pilot=args.pilot,
        simulated=Simulated(speed=None, rendered=args.rendered or roster.needs_pictures(args.pilot)),
        seed=args.seed,
        latency=LatencyPolicy.parse(args.latency),
        # Other pilots fly to the cap, so that all their declarations are counted. The oracle's flight ends with its
        # success, because par is the number of its steps until then.
        full=args.pilot != "oracle",
    )


def _reason(result: Result) -> str:
    if result.error:
        return f": {result.error}"
    return f", {result.ne_m:.1f} m away at the end" if result.ne_m is not None else ""


def _keep(steps: dict[str, int]) -> None:
    """Store the oracle's steps as the par (reference step count) of shipped episodes. Other episodes keep their par."""
    from episodes.records import catalogue

    table = {**catalogue.load_par(), **steps}
    write_json(catalogue.PAR, {episode: table[episode] for episode in catalogue.all_ids() if episode in table})


def _keep_blind(pilot: str, flights: "dict[str, BlindFlight]") -> None:
    """Store a blind pilot's results in shipped episodes in blind.json."""
    from episodes.records import catalogue

    blind = catalogue.merged(catalogue.load_blind(), pilot, flights, catalogue.all_ids())
    write_json(catalogue.BLIND, blind)
