"""The three ways of commanding side by side, as docs/commanding.md has them.

    python -m benchmarks.commanding [EPISODE …] [--pilot NAME] [--drones N] [--seconds S] [--json] [--short]

Each episode is flown flat, solo and hierarchical in lockstep, the hierarchy under the scripted commander. Neither the
pilots nor that commander are models: tokens are those that a served pilot's endpoint estimates. `--short` flies one
episode for a few seconds, which shows whether all of it runs and no more.
"""

import argparse
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from dronecats.cli.exit_status import exit_status
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.pilots import roster
from episodes.records import suites
from foundation.run_folder.layout import DECISIONS
from foundation.run_folder.reading import exchanges, rows
from foundation.run_folder.rows import Decision

Mode = Literal["flat", "solo", "hierarchical"]


@dataclass(frozen=True, slots=True)
class CommandedFlight:
    """What one flight came to."""

    outcome: str
    declarations: int
    steps: int  # as numbered in decisions.jsonl
    seconds: float  # s of vehicle time
    asked: int  # questions to the pilot
    asked_tokens: int | None  # in and out, all of them; None: not told
    commanded: int  # questions to the commander
    commanded_tokens: int


def flown(mode: Mode, episode: str, pilot: str, drones: int | None, seconds: float) -> CommandedFlight:
    """Fly an episode, and return what it came to. Raises UsageError."""
    simulated = Simulated(speed=None, rendered=roster.looks(pilot))
    spec = FlightSpec(pilot=pilot, episode=episode, drones=drones, command=mode, simulated=simulated, seconds=seconds)
    with tempfile.TemporaryDirectory() as out:
        result = fly(spec, Path(out) / "run", lambda line: None)
        folder = Path(out) / "run" / episode
        decided = [d for d in rows(folder / DECISIONS, Decision) if isinstance(d.reply, str)]
        asked = {d.step: (d.tokens_in, d.tokens_out) for d in decided}  # a fleet's rows tell of one question
        counts = [count for pair in asked.values() for count in pair if count is not None]
        told = exchanges(folder)
        return CommandedFlight(
            outcome=result["outcome"],
            declarations=result["declarations"],
            steps=result["steps"],
            seconds=result["sim_seconds"],
            asked=len(asked),
            asked_tokens=sum(counts) if counts else None,
            commanded=len(told),
            commanded_tokens=sum((one.tokens_in or 0) + (one.tokens_out or 0) for one in told),
        )


def table(found: dict[str, list[CommandedFlight]]) -> str:
    """Return the rows of each mode as Markdown; all but `solved` are means over its flights."""
    lines = [
        "| command | solved | declarations | steps | seconds | questions | tokens | to the commander | its tokens |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for mode, flights in found.items():
        solved = sum(one.outcome == "success" for one in flights)
        tokens = [one.asked_tokens for one in flights if one.asked_tokens is not None]
        means = [
            sum(values) / len(flights)
            for values in (
                [one.declarations for one in flights],
                [one.steps for one in flights],
                [one.seconds for one in flights],
                [one.asked for one in flights],
            )
        ]
        numbers = " | ".join(f"{mean:.1f}" for mean in means)
        cost = f"{sum(tokens) / len(tokens):.0f}" if tokens else "–"
        asked = sum(one.commanded for one in flights) / len(flights)
        above = f"{asked:.1f} | {sum(one.commanded_tokens for one in flights) / len(flights):.0f}" if asked else "– | –"
        lines.append(f"| {mode} | {solved}/{len(flights)} | {numbers} | {cost} | {above} |")
    return "\n".join(lines)


def main() -> int:
    """Fly, and print the table, or with --json every flight; return the exit status."""
    parser = argparse.ArgumentParser(description="the three ways of commanding, side by side")
    parser.add_argument("episodes", nargs="*", help="default: the commanding suite")
    parser.add_argument("--pilot", default="oracle", help="oracle (default) or vision")
    parser.add_argument("--drones", type=int, help="default: as many as the record has")
    parser.add_argument("--seconds", type=float, default=300.0, help="length of a flight (default 300)")
    parser.add_argument("--json", action="store_true", help="print every flight as one JSON object")
    parser.add_argument("--short", action="store_true", help="one episode, two drones, a few seconds")
    args = parser.parse_args()
    if args.short:
        args.episodes, args.drones, args.seconds = ["blocks-commanding-01"], 2, 4.0
    chosen = args.episodes or suites.ids("commanding")
    found: dict[str, list[CommandedFlight]] = {mode: [] for mode in get_args(Mode)}
    for episode in chosen:
        for mode in get_args(Mode):
            one = flown(mode, episode, args.pilot, args.drones, args.seconds)
            found[mode].append(one)
            if args.json:
                print(json.dumps({"episode": episode, "command": mode, **_plain(one)}), flush=True)
    if not args.json:
        print(table(found))
    return 0


def _plain(one: CommandedFlight) -> dict[str, object]:
    return {name: getattr(one, name) for name in one.__dataclass_fields__}


if __name__ == "__main__":
    raise SystemExit(exit_status("benchmarks.commanding", main))
