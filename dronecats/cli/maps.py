"""Verb `maps`: lists, shows and exports maps, and imports maps of the user."""

import argparse
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.cli.next_commands import print_next
from dronecats.cli.output import show
from dronecats.report.table import ReportTable, table_of, words
from foundation.errors import UsageError
from foundation.files import file_errors_as


def add_maps_options(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="print one line per map")
    listing.add_argument("--json", action="store_true", help="print one JSON object")
    showing = actions.add_parser("show", help="print extent, triangles, objects and origin of a map")
    showing.add_argument("name", metavar="NAME", help="map, as in `dronecats maps list`")
    showing.add_argument("--seed", type=int, default=1, help="seed of a shipped map (default 1)")
    showing.add_argument("--json", action="store_true", help="print one JSON object")
    export = actions.add_parser("export", help="write a map as a binary glTF file")
    export.add_argument("name", metavar="NAME", help="map, as in `dronecats maps list`")
    export.add_argument("--seed", type=int, default=1, help="seed of a shipped map (default 1)")
    export.add_argument("--out", type=Path, required=True, metavar="FILE.glb", help="file to write")
    bring = actions.add_parser("import", help="check a binary glTF file and keep it as your own map")
    bring.add_argument("file", type=Path, metavar="FILE.glb", help="file to import")
    bring.add_argument("--name", required=True, help="name of your map: small letters, digits and hyphens")
    bring.add_argument(
        "--spawn",
        type=spawn,
        metavar="NORTH,EAST[,DOWN]",
        help="a free place on the ground, in metres; if the first number is negative, write --spawn=-3,4",
    )
    bring.add_argument("--replace", action="store_true", help="replace your map of this name")
    parser.set_defaults(run=run)


def spawn(text: str) -> tuple[float, ...]:
    """Return the two or three numbers (m, NED) of the option --spawn."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (2, 3) or not all(math.isfinite(v) for v in values):
        raise argparse.ArgumentTypeError(
            f"{text!r} must be NORTH,EAST or NORTH,EAST,DOWN in metres, for example --spawn=0,-3"
        )
    return values


def run(args: argparse.Namespace) -> int:
    """List, show, export or import maps."""
    from episodes import maps
    from episodes.maps import gltf, user

    if args.action == "list":
        rows = [{"name": name, "origin": "shipped"} for name in maps.shipped()]
        rows += [{"name": name, "origin": "yours"} for name in user.names()]
        if args.json:
            print(json.dumps({"maps": rows}))
        else:
            show(table_of((words("map"), words("origin")), ((row["name"], row["origin"]) for row in rows)))
        return 0
    if args.action == "import":
        scene = user.add(args.file, args.name, args.spawn, maps.shipped(), args.replace)
        show(_table(_facts(scene)))
        print_next("maps import", map=args.name)
        return 0
    scene = maps.build(args.name, args.seed)
    if args.action == "show":
        if args.json:
            print(json.dumps(_facts(scene)))
        else:
            show(_table(_facts(scene)))
        return 0
    with file_errors_as(UsageError, f"'{args.out}' cannot be written"):
        gltf.save(scene, args.out)
    print(f"written: {args.out}, {args.out.stat().st_size / 1e6:.1f} MB")
    return 0


def _facts(scene: Any) -> dict[str, Any]:
    """Return the facts about a map for `show` and `import`, as JSON values."""
    from episodes.maps.gltf.reader import extent

    low, high = extent(scene)
    pictures = {id(m.texture): m.texture for i in scene.instances for m in i.mesh.materials if m.texture is not None}
    kinds: dict[str, int] = {}
    for instance in scene.instances:
        kinds[instance.kind] = kinds.get(instance.kind, 0) + 1
    return {
        "name": scene.name,
        "north_m": [round(low[0], 2), round(high[0], 2)],
        "east_m": [round(low[1], 2), round(high[1], 2)],
        "height_m": [round(0.0 - high[2], 2), round(0.0 - low[2], 2)],
        "triangles": sum(len(instance.mesh.triangles) for instance in scene.instances),
        "instances": len(scene.instances),
        "kinds": dict(sorted(kinds.items())),
        "texels": sum(p.shape[0] * p.shape[1] for p in pictures.values()),
        "ground_cell_m": round(scene.terrain.cell_m, 3),
        "spawn_ned": [round(v, 3) for v in scene.spawn_ned],
        "latitude_deg": scene.latitude_deg,
        "longitude_deg": scene.longitude_deg,
        "altitude_m": scene.altitude_m,
        "notes": list(scene.notes),
    }


def _table(facts: dict[str, Any]) -> ReportTable:
    (n0, n1), (e0, e1), (h0, h1) = facts["north_m"], facts["east_m"], facts["height_m"]
    kinds = ", ".join(f"{count} {kind}" for kind, count in facts["kinds"].items())
    lines = [
        ("extent", f"north {n0:g} … {n1:g} m, east {e0:g} … {e1:g} m, height {h0:g} … {h1:g} m"),
        ("triangles", f"{facts['triangles']:,}, textures of {facts['texels'] / 1e6:.1f} million texels"),
        ("objects", f"{facts['instances']}: {kinds[:600]}"),
        ("ground", f"heights in a grid of {facts['ground_cell_m']:g} m"),
        ("spawn", f"{', '.join(f'{v:g}' for v in facts['spawn_ned'])} m north, east, down"),
        ("origin", f"{facts['latitude_deg']:.6f}°, {facts['longitude_deg']:.6f}°, {facts['altitude_m']:g} m"),
        *(("note", note) for note in facts["notes"]),
    ]
    return replace(table_of((words(""), words("")), lines), title=facts["name"])
