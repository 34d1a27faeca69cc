"""How many episodes an hour a machine flies, and what going on with a benchmark that is flown costs.

    python -m benchmarks.bench [--json] [--suite NAME] [--jobs N] [--rendered] [--short]

`episodes_per_hour` is of `dronecats bench --pilot oracle` as it is typed, from the start of the command to its end: the
start of the workers, ascents, landings and verdicts included. `cpu_s_per_episode` is the processor time of all of its
processes by the episodes, which a busy machine changes less. `again_s` is what the same command takes when nothing is
left to fly.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from benchmarks.machine import Machine


def flown(out: Path, words: list[str]) -> tuple[dict[str, Any], float, float]:
    """Return (what the command printed, its wall seconds, the processor seconds of all of its processes)."""
    command = [sys.executable, "-m", "dronecats.cli.main", "bench", "--out", str(out), "--json", *words]
    began_s, before_s = time.monotonic(), _cpu_s()
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1]), time.monotonic() - began_s, _cpu_s() - before_s


def _cpu_s() -> float:
    """Return the processor seconds of all children that have ended, and of theirs."""
    used = psutil.Process().cpu_times()
    return float(used.children_user + used.children_system)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--suite", default="quick", metavar="NAME", help="whose episodes are flown (quick)")
    parser.add_argument("--jobs", type=int, metavar="N", help="flights in the air (one per core)")
    parser.add_argument("--rendered", action="store_true", help="draw every frame, which the oracle does not look at")
    parser.add_argument("--short", action="store_true", help="only show that every figure can be had")
    args = parser.parse_args()
    words = ["--suite", args.suite, "--pilot", "oracle", *(["--rendered"] if args.rendered else [])]
    words += ["--jobs", str(args.jobs)] if args.jobs else []
    words += ["--limit", "2"] if args.short else []
    machine = Machine()
    with tempfile.TemporaryDirectory() as folder:
        told, wall_s, cpu_s = flown(Path(folder) / "bench", words)
        _, again_s, _ = flown(Path(folder) / "bench", words)
    machine.look()
    found = {
        "episodes": told["done"],
        "solved": sum(row["solved"] for row in told["rows"] if row["group"] == "all"),
        "episodes_per_hour": round(3600.0 * told["done"] / wall_s),
        "cpu_s_per_episode": round(cpu_s / told["done"], 2),
        "again_s": round(again_s, 2),
        "machine": machine.figures(),
    }
    if args.json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name:20} {value}")


if __name__ == "__main__":
    main()
