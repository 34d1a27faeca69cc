"""From the words of `dronecats fly` to a flight."""

import argparse
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.agent.models.spec import PROVIDERS
from dronecats.cli.options import (
    ACCOUNTS,
    AGENT,
    COMMAND,
    DISTURBANCES,
    LATENCY,
    MODEL,
    REPLIES,
    Option,
    disturbances_of,
    first_set,
    is_set,
    key_of,
    model_of,
    speed,
)

if TYPE_CHECKING:
    from dronecats.flight.spec.flight_spec import Accounts, FlightSpec
    from hil.link.envelope import Limits

VEHICLE = (
    Option(name="sitl", kind=bool, help="simulate the vehicle, its autopilot and its camera"),
    Option(name="connect", metavar="URL", help="a vehicle that is running: udpin://0.0.0.0:14540, serial://…"),
    Option(
        name="sign", kind=Path, metavar="KEYFILE", vehicle="--connect",
        help="sign MAVLink messages, believe no others: docs/signing.md",
    ),
    Option(
        name="camera", metavar="URL", vehicle="--connect", beside_spec=True,
        help="http://, rtsp://, v4l2:0, a video file or a folder",
    ),
    Option(
        name="calibration", kind=Path, metavar="FILE", vehicle="--connect", help="the lens, see docs/cameras.md"
    ),
    Option(
        name="world", metavar="EPISODE", vehicle="--connect",
        help="the vehicle simulates itself, and flies this episode or map",
    ),
    Option(
        name="truth", metavar="URL", vehicle="--connect",
        help="with --world: its true poses, of a PX4 udpin://127.0.0.1:19410",
    ),
    Option(name="arm", kind=bool, vehicle="--connect", help="arm and take off after a typed yes; without it, you do"),
    Option(name="dry_run", kind=bool, vehicle="--connect", help="decide and draw, but move nothing"),
    Option(name="then", choices=("land", "return", "hold"), vehicle="--connect", help="how the flight ends"),
    Option(
        name="envelope", kind=Path, metavar="FILE", replay="may change",
        help="limits of the safety envelope: docs/envelope.md",
    ),
    Option(name="no_envelope", kind=bool, vehicle="--sitl", replay="may change", help="no limits at all"),
    Option(name="instruction", metavar="TEXT", vehicle="--connect", help="what the pilot is told"),
    Option(
        name="target", metavar="LAT,LON[,ALT]", vehicle="--connect", beside_spec=True,
        help="as surveyed, for the distances: docs/after-flight.md",
    ),
    Option(
        name="target_std", kind=float, metavar="M", vehicle="--connect", beside_spec=True,
        help="with --target: how well, per axis (3)",
    ),
    Option(name="airframe", metavar="NAME", vehicle="--sitl", replay="may change", help="default x500"),
    Option(
        name="optics", kind=Path, metavar="FILE", vehicle="--sitl", replay="may change", help="lens, noise, weather"
    ),
    Option(
        name="autopilot", choices=("ours", "px4"), vehicle="--sitl", replay="may change",
        help="who flies the simulated vehicle",
    ),
    Option(
        name="px4", metavar="COMMAND", vehicle="--sitl", replay="may change",
        help="with --autopilot px4: starts your PX4; without it, waits",
    ),
    Option(name="keep_ulog", kind=bool, help="with --connect or --px4: keep the log that PX4 writes on board"),
)  # fmt: skip
PILOT = (
    Option(
        name="pilot", metavar="NAME",
        help="vision (default), oracle, noisy, blind:NAME, failing:NAME, recorded:FILE; no models",
    ),
    Option(
        name="model", metavar="NAME",
        help=f"a row of `dronecats models list`; replay:RUN; or PROVIDER/NAME, of {', '.join(PROVIDERS)}",
    ),
    *MODEL,
    *ACCOUNTS,
    Option(
        name="ledger", kind=Path, metavar="FILE", help="with --model: of several runs (in the folder)", beside_spec=True
    ),
    *REPLIES,
    AGENT,
)  # fmt: skip
RUN = (
    Option(
        name="episode", metavar="ID", vehicle="--sitl", replay="may change", beside_spec=True,
        help="id or file (default: go to the cyan SUV)",
    ),
    Option(
        name="drones", kind=int, metavar="N", vehicle="--sitl", replay="as recorded",
        help="1 to 8 of a commanding episode (default: its four)",
    ),
    Option(
        name="speed", metavar="N|max", vehicle="--sitl", replay="may change",
        help="factor on real time (default 1); max is lockstep",
    ),
    Option(
        name="seed", kind=int, vehicle="--sitl", replay="may change",
        help="tells flights of one episode apart (default 0)",
    ),
    Option(name="seconds", kind=float, vehicle="--connect", help="length of the flight (300)"),
    Option(
        name="patience", kind=float, metavar="S", vehicle="--connect",
        help="end the flight after S without a reply (60)",
    ),
    Option(
        name="spec", kind=Path, metavar="FILE", help="fly what a run.json says, or the flight in it, once more",
        beside_spec=True,
    ),
    Option(
        name="full", kind=bool, vehicle="--sitl", replay="may change",
        help="fly to the cap even when the verdict is decided",
    ),
    Option(name="out", kind=Path, metavar="DIR", help="run folder (default runs/TIME-PILOT)", beside_spec=True),
    Option(name="json", kind=bool, help="end with one JSON object on standard output", beside_spec=True),
)  # fmt: skip
OPTIONS = (*VEHICLE, *PILOT, COMMAND, LATENCY, *DISTURBANCES, *RUN)
BESIDE_SPEC = {"verb", "run", "view", "view_port", "view_stay", *(each.name for each in OPTIONS if each.beside_spec)}
REPLAY = "replay:"
SCRIPTED = "scripted:"  # before the name of a built-in commander
PATIENCE_S = 60.0  # s without a reply after which a connected vehicle is brought to an end of its flight


def spec_of(args: argparse.Namespace) -> "FlightSpec":
    """Return the flight that was asked for. Raises UsageError for words that do not go together."""
    from foundation.errors import UsageError

    if args.spec:
        return _read(args)
    if args.sitl == bool(args.connect):
        raise UsageError("choose one vehicle: --sitl for a simulated one, or --connect URL")
    if args.model and args.pilot:
        raise UsageError("choose one pilot: --pilot NAME or --model PROVIDER/NAME")
    if not args.model and (alone := first_set(args, MODEL)):
        raise UsageError(f"{alone.flag} goes with --model PROVIDER/NAME, for example --model local/my-model")
    if args.commander_url and (not args.commander or args.commander.startswith(SCRIPTED)):
        raise UsageError("--commander-url goes with --commander PROVIDER/NAME, for example --commander local/my-model")
    vehicle = "--connect" if args.connect else "--sitl"
    stray = first_set(args, (each for each in OPTIONS if each.vehicle not in (None, vehicle)))
    if stray and stray.name == "no_envelope":
        raise UsageError("--no-envelope goes with --sitl; a real vehicle's limits can be moved: --envelope FILE")
    if stray:
        raise UsageError(f"{stray.flag} goes with {stray.vehicle}; leave it out")
    if (args.model or "").startswith(REPLAY):
        return _replayed(args)
    return _connected(args) if args.connect else _simulated(args)


def _simulated(args: argparse.Namespace) -> "FlightSpec":
    from dronecats.flight.spec.flight_spec import LATENCY, FlightSpec, Simulated
    from dronecats.flight.spec.latency_trace import latency_policy
    from episodes.camera.optics.file import load as load_optics
    from episodes.records import catalogue

    factor = speed(args.speed or "1")
    vehicle = Simulated(
        airframe=args.airframe or Simulated().airframe,
        autopilot=args.autopilot or "ours",
        px4=args.px4,
        speed=factor,
        optics=load_optics(args.optics).as_dict() if args.optics else None,
    )
    return FlightSpec(
        **_of_episode(args.episode or catalogue.DEFAULT),
        **_of_pilot(args),
        simulated=vehicle,
        drones=args.drones,
        latency=latency_policy(args.latency or (LATENCY if factor is None else "real")),
        parser=args.parser or "strict",
        stop_unreadable=args.stop_unreadable,
        disturbances=disturbances_of(args),
        seed=args.seed or 0,
        full=args.full,
        envelope=_envelope(args),
        keep_ulog=args.keep_ulog,
    )


def _replayed(args: argparse.Namespace) -> "FlightSpec":
    """Return a recorded flight, but for what is said otherwise."""
    from dronecats.flight.spec.flight_spec import Simulated
    from dronecats.flight.spec.latency_trace import latency_policy
    from dronecats.flight.spec.recording import recorded
    from episodes.camera.optics.file import load as load_optics
    from foundation.errors import UsageError

    path = args.model.removeprefix(REPLAY)
    if args.keep_ulog:
        raise UsageError("--keep-ulog does not go with --model replay:RUN; leave it out")
    if args.connect:
        raise UsageError("--model replay:RUN goes with --sitl; a connected vehicle flies --pilot recorded:FILE")
    if args.base_url:
        raise UsageError("a replay asks nobody: leave --base-url out")
    if stray := first_set(args, (each for each in OPTIONS if each.replay == "as recorded")):
        raise UsageError(f"{stray.flag} is as it was on the flight that --model replay:RUN flies again: leave it out")
    spec = recorded(Path(path))
    vehicle = spec.simulated or Simulated()
    for name in ("airframe", "autopilot", "px4"):
        if (value := getattr(args, name)) is not None:
            vehicle = replace(vehicle, **{name: value})
    if args.speed:
        vehicle = replace(vehicle, speed=speed(args.speed))
    if args.optics:
        vehicle = replace(vehicle, optics=load_optics(args.optics).as_dict())
    changes: dict[str, Any] = {"simulated": vehicle, "accounts": _accounts(args), "full": args.full or spec.full}
    if args.episode:
        changes |= {"episode": None, "record": None, **_of_episode(args.episode)}
    changes["disturbances"] = disturbances_of(args, spec.disturbances)
    kept = ("seed", "parser", "stop_unreadable")
    changes |= {name: value for name in kept if (value := getattr(args, name)) is not None}
    if args.latency:
        changes["latency"] = latency_policy(args.latency)
    if args.prompt:
        changes |= {"prompt": template_of(args.prompt)}
    if args.no_envelope or args.envelope:
        changes |= {"envelope": _envelope(args)}
    return replace(spec, **changes)


def replay_line(args: argparse.Namespace, flight: str) -> str:
    """Return what a replay takes from the recorded flight, and what not, a sentence."""
    changed = [each.flag for each in OPTIONS if each.replay == "may change" and is_set(getattr(args, each.name))]
    other = f", but for {', '.join(changed)}" if changed else ""
    return f"replay of {flight}: replies, episode, vehicle, clock, latency and seed as they were{other}"


def _accounts(args: argparse.Namespace) -> "Accounts":
    from dronecats.agent.models.ledger import cost_limit, token_limit
    from dronecats.flight.spec.flight_spec import Accounts

    return Accounts(
        cost_limit_usd=None if args.cost_limit is None else cost_limit(args.cost_limit),
        token_limit=None if args.token_limit is None else token_limit(args.token_limit),
        ledger=str(args.ledger) if args.ledger else None,
        cache=str(args.cache) if args.cache else None,
    )


def template_of(file: Path) -> str:
    from dronecats.agent.prompt import Prompt

    return Prompt.load(file).template


def _envelope(args: argparse.Namespace) -> "Limits | None":
    from foundation.errors import UsageError
    from hil.link.envelope import SIMULATED

    if args.no_envelope and args.envelope:
        raise UsageError("--no-envelope and --envelope FILE contradict each other; choose one")
    return None if args.no_envelope else _limits(args.envelope, SIMULATED)


def _connected(args: argparse.Namespace) -> "FlightSpec":
    from dronecats.flight.spec.flight_spec import Authority, Connected, FlightSpec
    from dronecats.flight.spec.latency_trace import latency_policy
    from foundation.errors import UsageError
    from hil.cameras.lens import load as load_calibration
    from hil.link.envelope import Limits

    _check_eyes(args)
    key_of(args.sign)
    if args.arm and args.dry_run:
        raise UsageError("--dry-run moves nothing, so it goes without --arm")
    vehicle = Connected(
        url=args.connect,
        camera=args.camera,
        calibration=load_calibration(args.calibration) if args.calibration else None,
        truth=args.truth,
        sign=str(args.sign) if args.sign else None,
        authority=Authority(arm=args.arm, then=args.then or ("land" if args.arm else "hold"), dry=args.dry_run),
    )
    return FlightSpec(
        **(_of_world(args.world, args.instruction) if args.world else {"instruction": args.instruction}),
        **_of_pilot(args),
        connected=vehicle,
        latency=latency_policy(args.latency or "real"),
        parser=args.parser or "strict",
        stop_unreadable=args.stop_unreadable,
        patience_s=PATIENCE_S if args.patience is None else args.patience,
        **({} if args.seconds is None else {"seconds": args.seconds}),
        envelope=_limits(args.envelope, Limits()),
        keep_ulog=args.keep_ulog,
    )


def _read(args: argparse.Namespace) -> "FlightSpec":
    """Return the flight of a file, with what cannot stand in one, or is another, from the command line."""
    from dronecats.flight.spec.spec_file import hidden, read
    from foundation.errors import UsageError

    stray = next((name for name, value in vars(args).items() if name not in BESIDE_SPEC and is_set(value)), None)
    if stray:
        raise UsageError(f"--spec says what is flown: leave --{stray.replace('_', '-')} out")
    spec = read(args.spec)
    if args.episode:
        spec = replace(spec, **{"episode": None, "record": None, "map": None, **_of_episode(args.episode)})
    if args.base_url and spec.model:
        spec = replace(spec, model=replace(spec.model, base_url=args.base_url))
    changed = {name: value for name, value in asdict(_accounts(args)).items() if value is not None}
    spec = replace(spec, accounts=replace(spec.accounts, **changed))
    if args.commander_url and spec.commander:
        spec = replace(spec, commander=replace(spec.commander, base_url=args.commander_url))
    if args.camera and spec.connected:
        spec = replace(spec, connected=replace(spec.connected, camera=args.camera))
    if not spec.replay and (missing := hidden(spec)):
        raise UsageError(f"--spec {args.spec} does not hold the whole address, which may have a key: add {missing[0]}")
    if spec.simulated and not (spec.episode or spec.record or spec.map):
        raise UsageError(f"--spec {args.spec} is of a run of several episodes: name one with --episode")
    return spec


def _of_pilot(args: argparse.Namespace) -> dict[str, Any]:
    from dronecats.pilots import roster

    told: dict[str, Any] = {
        "prompt": template_of(args.prompt) if args.prompt else None,
        "accounts": _accounts(args),
        **({"agent": args.agent} if args.agent else {}),
        **commanded_by(args),
    }
    if args.model:
        return {"model": model_of(args.model, args), **told}
    return {"pilot": roster.check(args.pilot or "vision"), **told}


def commanded_by(args: argparse.Namespace) -> dict[str, Any]:
    """Return how a fleet is commanded, and by whom."""
    from dronecats.agent.models.rows import model_of as row_or_name
    from dronecats.agent.models.spec import provider_of
    from dronecats.pilots import roster
    from foundation.errors import UsageError

    told: dict[str, Any] = {"command": args.command} if args.command else {}
    if args.commander and args.commander.startswith(SCRIPTED):
        return {**told, "scripted": roster.check_commander(args.commander)}
    if args.commander:
        told["commander"] = commander = row_or_name(args.commander, args.commander_url)
        has_url = commander.base_url is not None or provider_of(commander.provider).base_url is not None
        if args.command == "hierarchical" and not has_url:  # else the flight refuses the commander itself
            raise UsageError(f"--commander {commander.title} needs --commander-url http://HOST:PORT/v1")
    return told


def _of_episode(name: str) -> dict[str, Any]:
    """Return which of a spec's fields name an episode: its id when it ships, and else its record."""
    import json

    from episodes.records import catalogue

    if name in catalogue.known():
        return {"episode": name}
    return {"record": json.loads(catalogue.load(name).to_json())}


def _of_world(name: str, instruction: str | None) -> dict[str, Any]:
    from episodes import maps
    from foundation.errors import UsageError

    if name in maps.names():
        if not instruction:
            raise UsageError(f"'{name}' is a map: say with --instruction what to do there, or name an episode")
        return {"map": name, "instruction": instruction}
    if instruction:
        raise UsageError("an episode brings its instruction: leave --instruction out, or name a map with --world")
    return _of_episode(name)


def _limits(file: Path | None, base: "Limits") -> "Limits":
    from hil.link.envelope import load

    return load(file, base) if file else base


def _check_eyes(args: argparse.Namespace) -> None:
    """Raise UsageError unless it is clear through what a connected vehicle looks, and what at."""
    from foundation.errors import UsageError

    if bool(args.world) != bool(args.truth):
        raise UsageError("--world and --truth go together: the world is drawn where the truth says that the vehicle is")
    if args.world and args.target:
        raise UsageError("--target goes without --world, whose truth is known; leave one of them out")
    if args.target_std is not None and not args.target:
        raise UsageError("--target-std goes with --target; add it or leave it out")
    if args.world and (args.camera or args.calibration):
        raise UsageError("--camera goes without --world, which draws the pictures itself; leave one of them out")
    if not args.world and not (args.camera and args.instruction):
        raise UsageError("--connect needs --camera URL and --instruction TEXT, or --world EPISODE and --truth URL")
