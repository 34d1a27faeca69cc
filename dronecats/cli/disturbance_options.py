"""The options of what is done to a flight on purpose, made from the declarations of `dronecats/flight/disturbances.py`.

An option that is not given has no value, so that a recorded flight keeps what it had.
"""

import argparse

from dronecats.flight.disturbances import DECLARED, OPTIONS, UNDISTURBED, Disturbances

NAMES = tuple(option.name for option in OPTIONS)


def add_disturbance_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options, in a group of their own."""
    group = parser.add_argument_group("disturbances, of what is simulated (docs/disturbances.md)")
    for _, _, declaration in DECLARED:
        if option := declaration.option:
            quantity = None if option.read else declaration.quantity
            text = f"{option.help}; {quantity.wanted}" if quantity else option.help
            flag = f"--{option.name.replace('_', '-')}"
            group.add_argument(flag, type=option.kind, metavar=option.metavar, help=text)


def disturbances_of(args: argparse.Namespace, base: Disturbances = UNDISTURBED) -> Disturbances:
    """Return what the options say, over what `base` has. Raises UsageError for what cannot be."""
    return base.with_options({name: value for name in NAMES if (value := getattr(args, name)) is not None})
