"""What is done to a flight on purpose, as `fly` and `bench` have it: of pictures, wire and vehicle.

An option that is not given has no value, so that a recorded flight keeps what it had. docs/disturbances.md
"""

import argparse
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dronecats.flight.spec.disturbances import Disturbances


@dataclass(frozen=True, slots=True)
class DisturbanceOption:
    """One of them: in a bench.toml a word of the same name."""

    name: str  # as argparse has it
    metavar: str
    help: str
    field: str  # of the faults that it sets
    kind: type[float] | type[str] = float


FRAME = (
    DisturbanceOption("frame_delay", "S", "seconds from the shutter until the agent has a picture", "delay_s"),
    DisturbanceOption("frame_drop", "P", "share of pictures that never come, 0 to 0.95", "dropped"),
    DisturbanceOption("frame_stale", "P", "share of questions on the picture of the question before", "stale"),
    DisturbanceOption("frame_rate", "HZ", "pictures are taken so often, not when asked for", "rate_hz"),
)
VEHICLE = (
    DisturbanceOption("gusts", "W20", "Dryden gusts of a wind of so many m/s at 20 ft; 7.7 is light", "gusts_w20"),
    DisturbanceOption("payload", "KG", "carried from boot, which the autopilot knows nothing of", "payload_kg"),
    DisturbanceOption("gps_delay", "S", "seconds by which GPS fixes are older than they say", "gps_delay_s"),
    DisturbanceOption("gps_noise", "X", "times the errors of GPS fixes", "gps_noise"),
    DisturbanceOption("sensor_noise", "X", "times the noise of the other sensors", "estimator_noise"),
    DisturbanceOption("setpoint_rate", "HZ", "how often the agent sends its setpoint, 2 to 50 (20)", "setpoint_hz"),
)
LISTED = (  # of several numbers or words each
    DisturbanceOption("link", "WORDS", "the MAVLink wire: delay=0.1,loss=0.05,to.jitter=0.02 …", "link", str),
    DisturbanceOption("wind", "N,E", "m/s that the air moves north and east, for example --wind=-4,3", "wind_ned", str),
    DisturbanceOption(
        "host_stalls", "P,S", "in a share P of seconds the simulator stands still for S; real time only", "stalled", str
    ),
)
OPTIONS = (*FRAME, *LISTED, *VEHICLE)
NAMES = tuple(each.name for each in OPTIONS)


def add_disturbance_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options, in a group of their own."""
    group = parser.add_argument_group("disturbances, of what is simulated (docs/disturbances.md)")
    for each in OPTIONS:
        group.add_argument(f"--{each.name.replace('_', '-')}", type=each.kind, metavar=each.metavar, help=each.help)


def disturbances_of(
    args: argparse.Namespace, base: "Disturbances | None" = None, *, lockstep: bool = False
) -> "Disturbances":
    """Return what is asked for, over what `base` has (None: nothing). Raises UsageError for what cannot be."""
    from dronecats.cli.link_option import link_faults
    from dronecats.flight.spec.disturbances import UNDISTURBED
    from foundation.errors import UsageError

    base = base or UNDISTURBED
    faults = _given(args, VEHICLE)
    if args.wind is not None:
        faults["wind_ned"] = (*_two("wind", args.wind, "N,E in m/s, for example 4,-3"), 0.0)
    if args.host_stalls is not None:
        told = "a share of seconds and how long each lasts, for example 0.1,0.5"
        faults["stalled"], faults["stall_s"] = _two("host-stalls", args.host_stalls, told)
    found = replace(
        base,
        frame=replace(base.frame, **_given(args, FRAME)),
        link=base.link if args.link is None else link_faults(args.link),
        vehicle=replace(base.vehicle, **faults),
    )
    if lockstep and found.vehicle.stalled:
        raise UsageError("--host-stalls goes with --speed N: in lockstep everything waits for everything")
    return found


def _two(option: str, text: str, wants: str) -> tuple[float, float]:
    from foundation.errors import UsageError

    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--{option} wants {wants}; got '{text}'") from None
    return first, second


def _given(args: argparse.Namespace, options: tuple[DisturbanceOption, ...]) -> dict[str, Any]:
    """Return the fields that options set; a whole number of a file is a number like any other."""
    return {each.field: each.kind(value) for each in options if (value := getattr(args, each.name)) is not None}
