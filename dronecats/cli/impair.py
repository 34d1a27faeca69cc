"""Verb `impair`: forwards MAVLink between an agent and an autopilot over a simulated lossy, slow link."""

import argparse
from typing import Any

from dronecats.cli.exit_status import interrupt_on_signals
from foundation.declaration import DeclaredNumber, declarations
from foundation.errors import UsageError
from foundation.redaction import redacted
from hil.impairment import ImpairedWire, Impairment
from hil.link.transport import connect

DIRECTIONS = "A both ways, or A,B: A towards the autopilot and B from it"
QUANTITIES: dict[str, DeclaredNumber] = {  # field of Impairment → the option that sets it; --baud 0: no limit
    name: field.quantity for name, field in declarations(Impairment).items() if field.quantity
}


def add_impair_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--listen", required=True, metavar="URL", help="where the agent connects: udpin://…, tcpin://…")
    parser.add_argument("--to", required=True, metavar="URL", help="the autopilot: udpout://…, tcp://…, serial://…")
    wire = parser.add_argument_group("link", f"Each option takes {DIRECTIONS}.")
    for name, declaration in QUANTITIES.items():
        default = f"{getattr(Impairment(), name) or 0:g}"
        text = f"{declaration.help}; {declaration.wanted}, default {default}"
        wire.add_argument(f"--{declaration.name}", metavar="A[,B]", help=text)
    wire.add_argument(
        "--cut", action="append", default=[], metavar="FROM:TO", help="cut the link, in seconds since the start"
    )
    parser.add_argument("--seed", type=int, default=0, help="equal seeds lose equal frames (default 0)")
    parser.add_argument("--report", type=float, metavar="S", help="print the counts every S seconds")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Forward until Ctrl-C, then print the counts. The exit status is 3 if a connection breaks."""
    import time

    if args.report is not None and not 0.1 <= args.report <= 3600.0:
        raise UsageError(f"--report must be 0.1 to 3600 seconds, got {args.report:g}")
    up, down = impairments(args)
    interrupt_on_signals()
    agent = connect(args.listen)
    try:
        autopilot = connect(args.to)
    except BaseException:
        agent.close()
        raise
    with ImpairedWire(agent, autopilot, up, down, args.seed) as wire:
        print(f"forwarding between {redacted(args.listen)} and {redacted(args.to)}; Ctrl-C ends it", flush=True)
        try:
            reported_s = 0.0
            while True:
                time.sleep(0.1)
                wire.check()
                if args.report is not None and wire.time_s >= reported_s + args.report:
                    reported_s = wire.time_s
                    print(_counts(wire), flush=True)
        except KeyboardInterrupt:
            return 0
        finally:
            print(_counts(wire), flush=True)


def impairments(args: argparse.Namespace) -> tuple[Any, Any]:
    """Return the impairments (towards the autopilot, from the autopilot). Raises UsageError."""
    cuts = tuple(_cut(text) for text in args.cut)
    options = {name: (quantity, getattr(args, quantity.name)) for name, quantity in QUANTITIES.items()}
    pairs = {name: _pair(quantity, text) for name, (quantity, text) in options.items() if text is not None}
    if "queue_bytes" in pairs and not any(pairs.get("baud", ())):
        raise UsageError("--queue needs a --baud above 0, which makes a serial line. Add it, or leave --queue out")
    directions = []
    for direction in (0, 1):
        values: dict[str, Any] = {name: pair[direction] for name, pair in pairs.items()}
        directions.append(Impairment(**{**values, "baud": values.get("baud") or None}, cuts=cuts))
    return directions[0], directions[1]


def _pair(quantity: DeclaredNumber, text: str) -> tuple[float, float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 2) or not all(abs(value) < 1e12 for value in values):
        raise UsageError(f"--{quantity.name} must be {DIRECTIONS}; got '{text}'")
    first, last = (int(value) if quantity.whole else value for value in (values[0], values[-1]))
    return first, last


def _cut(text: str) -> tuple[float, float]:
    try:
        start, end = (float(part) for part in text.split(":"))
    except ValueError:
        raise UsageError(f"--cut must be FROM:TO in seconds, for example 20:30; got '{text}'") from None
    return start, end


def _counts(wire: Any) -> str:
    return f"{wire.time_s:7.1f} s  to the autopilot: {wire.up.counts}\n{'':9}  from it: {wire.down.counts}"
