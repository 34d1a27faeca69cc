"""Fits the data files that ship with the vision pilot and the noisy pilot.

    python -m dronecats.pilots.fitting shapes [--out FOLDER] [--scenes N] [--pictures N] [--rounds N]
    python -m dronecats.pilots.fitting colors [--out FOLDER] [--scenes N] [--pictures N] [--rounds N]
    python -m dronecats.pilots.fitting vision-errors RUN [--out FOLDER]

`shapes` fits the network of `shape_detector`. `colors` fits the network of `color_detector` and makes the outlines
(outer points of targets) that `ranging` uses. Both fits render pictures of places that no episode record uses.
`--check [FOLDER]` only evaluates a network, on scenes outside the fit. `--short` tests in seconds that the fit runs,
and writes files only with `--out`. All random numbers are seeded; the last digits of the results depend on the
processor and the linear algebra library.

`vision-errors` fits the errors of `oracle/noisy.py` to RUN, the run folder of a benchmark with the pilot vision.
"""

import argparse
from pathlib import Path
from typing import Any

import msgspec

from dronecats.pilots.fitting import colors, shapes, vision_errors
from dronecats.pilots.oracle import noisy
from dronecats.pilots.vision import color_detector
from foundation.errors import UsageError


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m dronecats.pilots.fitting", description="Fits the vision pilot.")
    fits = parser.add_subparsers(dest="fit", required=True)
    shipped = Path(color_detector.__file__).parent
    networks: dict[str, Any] = {"shapes": shapes, "colors": colors}
    for name, fit in networks.items():
        network = fits.add_parser(name, help=f"the network of the {name}")
        network.add_argument("--out", type=Path, help="folder to write to (default: replace the shipped files)")
        for option, count, what in (
            ("--scenes", fit.SCENES, "number of scenes to fit to"),
            ("--pictures", fit.PICTURES, "pictures of each scene"),
            ("--rounds", fit.ROUNDS, "rounds of the fit"),
        ):
            network.add_argument(option, type=int, default=count, help=f"{what} (default {count})")
        network.add_argument(
            "--check", type=Path, nargs="?", const=shipped, help="only check the network in this folder"
        )
        network.add_argument("--short", action="store_true", help="one scene and one round, to see that it runs")
    errors = fits.add_parser("vision-errors", help="the errors of the noisy pilot")
    errors.add_argument("run", type=Path, help="run folder of a benchmark with the pilot vision")
    shipped_errors = noisy.FILE.parent
    errors.add_argument("--out", type=Path, default=shipped_errors, help="folder (default: replace the shipped file)")
    args = parser.parse_args()
    if args.out is not None:
        args.out.mkdir(parents=True, exist_ok=True)
    if args.fit == "vision-errors":
        try:
            errors_of_run = vision_errors.fit_run(args.run)
        except UsageError as error:
            parser.error(str(error))
        data = msgspec.json.format(msgspec.json.encode(errors_of_run), indent=2) + b"\n"
        (args.out / noisy.FILE.name).write_bytes(data)
        print(data.decode(), end="")
        return
    fit = networks[args.fit]
    folder = args.check
    if folder is None:
        network = fit.fit_scenes(
            *((1, fit.SHORT_PICTURES, 1) if args.short else (args.scenes, args.pictures, args.rounds))
        )
        folder = args.out or (None if args.short else shipped)
        if folder is not None:
            fit.save(network, folder)
    if folder is not None:
        network = fit.NETWORK.load(folder / fit.NETWORK.FILE)
    size = (1, fit.SHORT_PICTURES) if args.short else (fit.CHECK_SCENES, fit.CHECK_PICTURES)
    fit.print_table(network, list(fit.draw(fit.CHECK_SEED, *size)))


if __name__ == "__main__":
    main()
