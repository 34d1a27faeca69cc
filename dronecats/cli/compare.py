"""Verb `compare`: measures the distance between the paths of two flights."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

from dronecats.cli.next_commands import print_next
from dronecats.cli.output import show
from dronecats.report.table import TableColumn, table_of
from foundation.errors import UsageError
from foundation.run_folder.layout import EPISODE


def add_compare_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "a", type=Path, metavar="RUN[/EPISODE]", help="a run folder, or the folder of one episode in it"
    )
    parser.add_argument(
        "b", type=Path, metavar="RUN[/EPISODE]", help="the other flight: a run folder or an episode folder"
    )
    parser.add_argument(
        "--within",
        type=float,
        default=1.0,
        metavar="M",
        help="largest distance that counts as equal, in metres (default 1)",
    )
    parser.add_argument(
        "--seconds", type=float, default=60.0, metavar="S", help="compare the first S seconds (default 60)"
    )
    parser.add_argument(
        "--align", choices=("step", "time"), help="pair poses by this (default step if all replies are equal)"
    )
    parser.add_argument("--keep-north", action="store_true", help="keep north up, instead of the first heading")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw both paths: .png, .svg or .pdf")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare the paths. Return 0 if they agree over --seconds, else 1."""
    from dronecats.report.path_comparison import compare, figures, same_replies
    from foundation.run_folder.reading import episode_folder, read

    for name in ("within", "seconds"):
        value = getattr(args, name)
        if not (math.isfinite(value) and value > 0):
            raise UsageError(f"--{name} must be a number above 0, got {value:g}")
    a, b = read(episode_folder(args.a)), read(episode_folder(args.b))
    same, steps = same_replies(a, b, args.seconds)
    align = args.align or ("step" if same == steps > 0 else "time")
    comparisons = compare(a, b, args.seconds, by_step=align == "step", keep_north=args.keep_north)
    result = {
        **figures(comparisons, args.within, args.seconds),
        "same_replies": same,
        "steps": steps,
        "aligned_by": align,
        "sources": ["truth" if logs.true else "estimate" for logs in (a, b)],
    }
    if args.plot:
        from dronecats.report.path_comparison import draw

        axes = "north,east" if args.keep_north else "ahead,right"
        draw(comparisons, (str(args.a), str(args.b)), args.within, args.plot, axes)
    if args.json:
        print(json.dumps(result))
    else:
        _print(result)
        if a.true == b.true and len({_record(path) for path in (args.a, args.b)}) == 1:  # one replay page can show both
            print_next("compare", flights=[args.a, args.b])
    return 0 if result["agree"] else 1


def _record(path: Path) -> bytes:
    """Return the bytes of a flight's episode record; empty if it has none."""
    from foundation.run_folder.reading import episode_folder

    file = episode_folder(path) / EPISODE
    return file.read_bytes() if file.is_file() else b""


def _print(result: dict[str, Any]) -> None:
    from foundation.run_folder.rows import drone_label

    heads = {"from_s": ("from", "s", 0), "to_s": ("to", "s", 1), "max_m": ("max", "m", 2), "mean_m": ("mean", "m", 2),
             "rms_m": ("rms", "m", 2)}  # fmt: skip
    columns = [TableColumn(name=n, title=t, unit=u, decimals=d) for n, (t, u, d) in heads.items()]
    a, b = result["sources"]
    replies = f"{result['same_replies']} of {result['steps']} replies are the same"
    print(f"{replies}, aligned by {result['aligned_by']}; poses: {a if a == b else f'{a} and {b}'}")
    for drone in result["drones"]:
        print(f"{drone_label(drone['drone'])}: paths of {drone['path_a_m']:.1f} m and {drone['path_b_m']:.1f} m")
        spans = ([span[name] for name in heads] for span in drone["minutes"])
        show(table_of(columns, spans))
        print(
            f"  {drone['final_m']:.2f} m apart at the end; no pose is more than {drone['beside_m']:.2f} m from the"
            " other path"
        )
    worst_m = max(drone["first"]["max_m"] for drone in result["drones"])
    if result["agree"]:
        print(f"AGREE: within {result['within_m']:g} m over {result['seconds']:g} s (at most {worst_m:.2f} m)")
    elif worst_m > result["within_m"]:
        print(f"DIFFER: {worst_m:.2f} m apart within {result['seconds']:g} s, more than {result['within_m']:g} m")
    else:
        print(f"TOO SHORT: both flights last {result['compared_s']:.1f} s, less than --seconds {result['seconds']:g}")
