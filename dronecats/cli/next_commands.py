"""Suggests the next commands at the end of a command, if standard output is a terminal.

Only this module declares these suggestions. A name in braces is replaced by a value from the finished command.
"""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

NEXT: dict[str, tuple[str, ...]] = {
    "doctor": ("fly --sitl --speed max --out runs/demo", "bench --suite quick --pilot vision"),
    "fly": ("replay {run}", "judge {run}", "report {run} --out report"),
    "fly --connect": ("replay {run}", "export {run} --to kml"),
    "sitl": ("preflight --connect {vehicle}",),
    "sitl --camera": (
        "preflight --connect {vehicle} --camera {camera}",
        'fly --connect {vehicle} --camera {camera} --instruction "go to the red van" --dry-run',
    ),
    "preflight": ('fly --connect {vehicle} --camera {camera} --instruction "go to the red van" --dry-run',),
    "preflight, fixable": ("preflight --connect {vehicle} --fix",),
    "bench": (
        "report {out} --out report",
        'query "SELECT run, episode, outcome, ne_m FROM episodes" {out}',
        "replay {flight}",
    ),
    "study": ("study report {out}",),
    "study report": ('query "SELECT run, count(*) AS episodes FROM episodes GROUP BY run" {study}',),
    "study rate": (
        "fly --sitl --speed max --latency {latency}",
        "bench --suite quick --pilot vision --latency {latency} --out {folder}-bench",
        "study run {study} --out {folder}-study",
    ),
    "judge": ("report {runs} --out report", "audit {runs}"),
    "report": ('query "SELECT run, episode, outcome, ne_m FROM episodes" {runs}', "audit {runs}"),
    "submit": ("verify {archive}",),
    "verify": ("leaderboard {archive} --out leaderboard.md",),
    "compare": ("replay {flights}",),
    "flightlog fetch": ("flightlog trace {run} --ulog {log}",),
    "flightlog trace": ("judge {run}", "replay {run}"),
    "tune": ("tune {airframe} --out plots",),
    "episodes new": ("episodes check {files}", "edit {file}", "fly --sitl --speed max --episode {file}"),
    "episodes check": ("edit {file}",),
    "episodes audit": ("report {run} --out report",),
    "models check": ("fly --sitl --model {model}",),
    "prompt extract": ("fly --sitl --model {model} --prompt {prompt}",),
    "maps import": ("maps show {map}", "edit {map}"),
    "camera calibrate": ("camera check {camera} --calibration {file}",),
}
KEEPS_RUNNING = ("sitl", "sitl --camera")  # commands that keep running, so the next ones need another terminal


def next_commands(made_by: str, **made: str | Path | Sequence[str | Path]) -> list[str]:
    """Return the commands to suggest after `made_by`, a key of NEXT, with the values in `made` filled in.

    A sequence becomes several words of the command line.
    """
    words = {name: shlex.join([str(value)] if isinstance(value, str | Path) else map(str, value))
             for name, value in made.items()}  # fmt: skip
    return [f"dronecats {command.format(**words)}" for command in NEXT[made_by]]


def print_next(made_by: str, **made: str | Path | Sequence[str | Path]) -> None:
    """Print the commands to suggest after `made_by` if standard output is a terminal."""
    if not sys.stdout.isatty():
        return
    lines = next_commands(made_by, **made)
    if made_by in KEEPS_RUNNING:
        print("\nnext, in another terminal:", *(f"  {line}" for line in lines), sep="\n", flush=True)
    else:
        print(f"\nnext: {lines[0]}", *(f"      {line}" for line in lines[1:]), sep="\n", flush=True)
