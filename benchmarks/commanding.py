"""Compares the three ways of commanding a fleet, as in docs/commanding.md.

    python -m benchmarks.commanding [EPISODE …] [--pilot NAME] [--drones N] [--seconds S] [--json] [--short]

Each episode is flown flat, solo and hierarchical in lockstep. The commander of the hierarchical flights is scripted.
The pilots and this commander are not models, so their tokens are estimates. `--short` flies one episode for a few
seconds and only checks that everything runs.
"""

import json
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import Literal, get_args

from benchmarks.machine import benchmark_parser
from dronecats.cli.exit_status import exit_status
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.pilots import roster
from episodes.records import catalogue
from foundation.run_folder.layout import DECISIONS
from foundation.run_folder.reading import exchanges, rows
from foundation.run_folder.rows import Decision

Mode = Literal["flat", "solo", "hierarchical"]


@dataclass(frozen=True, slots=True)
class CommandedFlight:
    """The result of one flight."""

    outcome: str
    declarations: int
    steps: int  # number of steps in decisions.jsonl
    seconds: float  # s of vehicle time
    questions: int  # questions to the pilot
    question_tokens: int | None  # input and output tokens of these questions; None: not reported
    commanded: int  # questions to the commander
    commanded_tokens: int


def fly_commanded(mode: Mode, episode: str, pilot: str, drones: int | None, seconds: float) -> CommandedFlight:
    """Fly an episode and return its result. Raises UsageError."""
    simulated = Simulated(speed=None, rendered=roster.needs_pictures(pilot))
    spec = FlightSpec(pilot=pilot, episode=episode, drones=drones, command=mode, simulated=simulated, seconds=seconds)
    with tempfile.TemporaryDirectory() as out:
        result = fly(spec, Path(out) / "run", lambda line: None)
        folder = Path(out) / "run" / episode
        decided = [d for d in rows(folder / DECISIONS, Decision) if isinstance(d.reply, str)]
        questions = {d.step: (d.tokens_in, d.tokens_out) for d in decided}  # rows of one step share a question
        counts = [count for pair in questions.values() for count in pair if count is not None]
        orders = exchanges(folder)
        return CommandedFlight(
            outcome=result["outcome"],
            declarations=result["declarations"],
            steps=result["steps"],
            seconds=result["sim_seconds"],
            questions=len(questions),
            question_tokens=sum(counts) if counts else None,
            commanded=len(orders),
            commanded_tokens=sum((order.tokens_in or 0) + (order.tokens_out or 0) for order in orders),
        )


def table(by_mode: dict[str, list[CommandedFlight]]) -> str:
    """Return a Markdown table with a row for each mode. All columns but `solved` are means over flights."""
    lines = [
        "| command | solved | declarations | steps | seconds | questions | tokens | to the commander | its tokens |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for mode, flights in by_mode.items():
        solved = sum(flight.outcome == "success" for flight in flights)
        tokens = [flight.question_tokens for flight in flights if flight.question_tokens is not None]
        names = ("declarations", "steps", "seconds", "questions", "commanded", "commanded_tokens")
        *means, commanded, commanded_tokens = (fmean(getattr(flight, name) for flight in flights) for name in names)
        numbers = " | ".join(f"{mean:.1f}" for mean in means)
        cost = f"{fmean(tokens):.0f}" if tokens else "–"
        above = f"{commanded:.1f} | {commanded_tokens:.0f}" if commanded else "– | –"
        lines.append(f"| {mode} | {solved}/{len(flights)} | {numbers} | {cost} | {above} |")
    return "\n".join(lines)


def main() -> int:
    """Fly the episodes; print the table, or every flight with --json; return the exit status."""
    parser = benchmark_parser(__doc__, short="fly one episode with two drones for a few seconds")
    parser.add_argument("episodes", nargs="*", help="episodes by id (default: the commanding suite)")
    parser.add_argument("--pilot", default="oracle", help="oracle (default) or vision")
    parser.add_argument("--drones", type=int, help="number of drones (default: as in the record)")
    parser.add_argument("--seconds", type=float, default=300.0, help="length of a flight (default 300)")
    args = parser.parse_args()
    if args.short:
        args.episodes, args.drones, args.seconds = ["blocks-commanding-01"], 2, 4.0
    chosen = args.episodes or catalogue.suite_ids("commanding")
    by_mode: dict[str, list[CommandedFlight]] = {mode: [] for mode in get_args(Mode)}
    for episode in chosen:
        for mode in get_args(Mode):
            flight = fly_commanded(mode, episode, args.pilot, args.drones, args.seconds)
            by_mode[mode].append(flight)
            if args.json:
                print(json.dumps({"episode": episode, "command": mode, **asdict(flight)}), flush=True)
    if not args.json:
        print(table(by_mode))
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_status("benchmarks.commanding", main))
