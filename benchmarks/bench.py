"""Measures how many episodes an hour a machine flies, and the cost of resuming a finished benchmark.

    python -m benchmarks.bench [--json] [--suite NAME] [--jobs N] [--rendered] [--short]

`episodes_per_hour` covers the whole command `dronecats bench --pilot oracle`, including the start of the workers,
ascents, landings and verdicts. `cpu_s_per_episode` is the processor time of all its processes per episode; it varies
less on a busy machine. `again_s` is the wall time of the same command when nothing is left to fly.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.machine import Machine, benchmark_parser, children_cpu_s, print_figures


def run_bench(out: Path, words: list[str]) -> tuple[dict[str, Any], float, float]:
    """Run `dronecats bench`; return its JSON summary, wall seconds, and processor seconds of all its processes."""
    command = [sys.executable, "-m", "dronecats.cli.main", "bench", "--out", str(out), "--json", *words]
    began_s, before_s = time.monotonic(), children_cpu_s()
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1]), time.monotonic() - began_s, children_cpu_s() - before_s


def main() -> None:
    """Print the figures."""
    parser = benchmark_parser(__doc__, short="quick check that every figure can be measured")
    parser.add_argument("--suite", default="quick", metavar="NAME", help="suite to fly (default quick)")
    parser.add_argument("--jobs", type=int, metavar="N", help="flights at a time (default one per core)")
    parser.add_argument("--rendered", action="store_true", help="render every frame, although the oracle uses none")
    args = parser.parse_args()
    words = ["--suite", args.suite, "--pilot", "oracle", *(["--rendered"] if args.rendered else [])]
    words += ["--jobs", str(args.jobs)] if args.jobs else []
    words += ["--limit", "2"] if args.short else []
    machine = Machine()
    with tempfile.TemporaryDirectory() as folder:
        summary, wall_s, cpu_s = run_bench(Path(folder) / "bench", words)
        _, again_s, _ = run_bench(Path(folder) / "bench", words)
    machine.look()
    figures = {
        "episodes": summary["done"],
        "solved": sum(row["solved"] for row in summary["rows"] if row["group"] == "all"),
        "episodes_per_hour": round(3600.0 * summary["done"] / wall_s),
        "cpu_s_per_episode": round(cpu_s / summary["done"], 2),
        "again_s": round(again_s, 2),
        "machine": machine.figures(),
    }
    print_figures(figures, args.json)


if __name__ == "__main__":
    main()
