"""Converts the options of `dronecats fly` into a FlightSpec."""

import argparse
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from dronecats.agent.models import rows
from dronecats.agent.models.spec import provider_of
from dronecats.agent.prompt import Prompt
from dronecats.cli.options import FLY, MODEL, accounts_of, first_set, is_set, key_of, model_of, speed
from dronecats.flight.spec.disturbances import UNDISTURBED
from dronecats.flight.spec.flight_spec import LATENCY, Authority, Connected, FlightSpec, Simulated, latency_policy
from dronecats.flight.spec.spec_file import options_with_redacted_address, read, recorded
from dronecats.pilots import roster
from episodes import maps
from episodes.camera.optics.file import load as load_optics
from episodes.records import catalogue
from foundation.errors import UsageError
from hil.cameras.lens import load as load_calibration
from hil.link import envelope
from hil.link.envelope import SIMULATED, Limits

PAGE = ("view", "view_port", "view_host", "view_stay")
ALLOWED_WITH_SPEC = {"verb", "run", *PAGE, *(option.name for option in FLY if option.beside_spec)}
REPLAY = "replay:"
SCRIPTED = "scripted:"  # before the name of a built-in commander
PATIENCE_S = 60.0  # default of --patience, s without a reply after which a real flight ends


def spec_of(args: argparse.Namespace) -> FlightSpec:
    """Return the requested flight. Raises UsageError for options that contradict each other."""
    if args.target_std is not None and not args.target:
        raise UsageError("--target-std goes with --target. Add it, or leave --target-std out")
    if args.spec:
        return _read(args)
    if args.sitl == bool(args.connect):
        raise UsageError("choose one vehicle: --sitl for a simulated one, or --connect URL")
    if not args.model and (alone := first_set(args, MODEL)):
        raise UsageError(f"{alone.flag} goes with --model PROVIDER/NAME, for example --model local/my-model")
    if args.commander_url and (not args.commander or args.commander.startswith(SCRIPTED)):
        raise UsageError("--commander-url goes with --commander PROVIDER/NAME, for example --commander local/my-model")
    vehicle = "--connect" if args.connect else "--sitl"
    stray = first_set(args, (option for option in FLY if option.vehicle not in (None, vehicle)))
    if stray and stray.name == "no_envelope":
        raise UsageError(
            "--no-envelope goes with --sitl only. For a real vehicle, change the limits with --envelope FILE"
        )
    if stray:
        raise UsageError(f"{stray.flag} goes with {stray.vehicle}. Leave it out")
    if (args.model or "").startswith(REPLAY):
        return _replayed(args)
    return _connected(args) if args.connect else _simulated(args)


def _simulated(args: argparse.Namespace) -> FlightSpec:
    vehicle = Simulated(**_of_vehicle(args))
    return FlightSpec(
        **_of_episode(args.episode or catalogue.DEFAULT),
        **_of_pilot(args),
        simulated=vehicle,
        drones=args.drones,
        latency=latency_policy(args.latency or (LATENCY if vehicle.speed is None else "real")),
        parser=args.parser or "strict",
        stop_unreadable=args.stop_unreadable,
        disturbances=UNDISTURBED.with_options(vars(args)),
        seed=args.seed or 0,
        full=args.full,
        envelope=_envelope(args),
        keep_ulog=args.keep_ulog,
    )


def _replayed(args: argparse.Namespace) -> FlightSpec:
    """Return the specification of a recorded flight, changed by the options that may change in a replay."""
    path = args.model.removeprefix(REPLAY)
    if args.connect:
        raise UsageError("--model replay:RUN goes with --sitl. For a connected vehicle use --pilot recorded:FILE")
    if stray := first_set(args, (option for option in FLY if option.replay == "as recorded")):
        raise UsageError(f"{stray.flag} cannot change in a replay (--model replay:RUN). Leave it out")
    spec = recorded(Path(path))
    vehicle = spec.simulated or Simulated()
    if args.autopilot == "ours":  # the recorded settings of PX4 no longer apply
        vehicle, spec = replace(vehicle, autopilot="ours", px4=None), replace(spec, keep_ulog=False)
    changes: dict[str, Any] = {
        "simulated": replace(vehicle, **_of_vehicle(args)),
        "accounts": accounts_of(args, args.ledger),  # not the recorded accounts, since a replay asks no model
        "full": args.full or spec.full,
    }
    if args.episode:
        changes |= {"episode": None, "record": None, **_of_episode(args.episode)}
    changes["disturbances"] = spec.disturbances.with_options(vars(args))
    kept = ("seed", "parser", "stop_unreadable")
    changes |= {name: value for name in kept if (value := getattr(args, name)) is not None}
    if args.latency:
        changes["latency"] = latency_policy(args.latency)
    if args.prompt:
        changes |= {"prompt": template_of(args.prompt)}
    if args.no_envelope or args.envelope:
        changes |= {"envelope": _envelope(args)}
    return replace(spec, **changes)


def _of_vehicle(args: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of `Simulated` that the options set."""
    names = ("airframe", "autopilot", "px4")
    fields: dict[str, Any] = {name: value for name in names if (value := getattr(args, name)) is not None}
    if args.speed:
        fields["speed"] = speed(args.speed)
    if args.depth:
        fields["camera"] = "depth"
    if args.optics:
        fields["optics"] = load_optics(args.optics).as_dict()
    return fields


def replay_line(args: argparse.Namespace, flight: str) -> str:
    """Return a sentence that names the values taken from the recorded flight, and the changed options."""
    changed = [o.flag for o in FLY if o.replay == "may change" and is_set(getattr(args, o.name))]
    exceptions = f", but with another {', '.join(changed)}" if changed else ""
    return f"Replay of {flight}, with its replies, episode, vehicle, clock, latency and seed{exceptions}"


def template_of(file: Path) -> str:
    return Prompt.load(file).template


def _envelope(args: argparse.Namespace) -> Limits | None:
    if args.no_envelope and args.envelope:
        raise UsageError("--no-envelope and --envelope FILE contradict each other. Choose one")
    return None if args.no_envelope else _limits(args.envelope, SIMULATED)


def _connected(args: argparse.Namespace) -> FlightSpec:
    if args.world and args.target:
        raise UsageError("--target does not go with --world, whose truth is known. Leave one of them out")
    key_of(args.sign)
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


def _read(args: argparse.Namespace) -> FlightSpec:
    """Return the flight in the file of --spec, changed by the options that are allowed with --spec."""
    stray = next((name for name, value in vars(args).items() if name not in ALLOWED_WITH_SPEC and is_set(value)), None)
    if stray:
        raise UsageError(f"--spec defines the flight. Leave --{stray.replace('_', '-')} out")
    spec = read(args.spec)
    applicable = {
        "base_url": spec.model,
        "commander_url": spec.commander,
        "camera": spec.connected,
        "target": spec.connected and not spec.connected.truth,
    }
    stray = next((name for name, part in applicable.items() if is_set(getattr(args, name)) and not part), None)
    if stray:
        raise UsageError(
            f"--{stray.replace('_', '-')} does not apply to the flight of --spec {args.spec}. Leave it out"
        )
    if args.episode:
        spec = replace(spec, **{"episode": None, "record": None, "map": None, **_of_episode(args.episode)})
    if args.base_url and spec.model:
        spec = replace(spec, model=replace(spec.model, base_url=args.base_url))
    changed = {name: value for name, value in asdict(accounts_of(args, args.ledger)).items() if value is not None}
    spec = replace(spec, accounts=replace(spec.accounts, **changed))
    if args.commander_url and spec.commander:
        spec = replace(spec, commander=replace(spec.commander, base_url=args.commander_url))
    if args.camera and spec.connected:
        spec = replace(spec, connected=replace(spec.connected, camera=args.camera))
    if not spec.replay and (missing := options_with_redacted_address(spec)):
        raise UsageError(
            f"--spec {args.spec} does not hold the whole address, because a part of it may be a key. Add {missing[0]}"
        )
    if spec.simulated and not (spec.episode or spec.record or spec.map):
        raise UsageError(f"--spec {args.spec} has several episodes. Name one with --episode")
    return spec


def _of_pilot(args: argparse.Namespace) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "prompt": template_of(args.prompt) if args.prompt else None,
        "accounts": accounts_of(args, args.ledger),
        **({"agent": args.agent} if args.agent else {}),
        **commanded_by(args),
    }
    if args.model:
        fields["model"] = model_of(args.model, args)
    if args.pilot or not args.model:
        fields["pilot"] = roster.check(args.pilot or "vision")
    return fields


def commanded_by(args: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of a flight that define how its fleet is commanded: command, commander, scripted."""
    fields: dict[str, Any] = {"command": args.command} if args.command else {}
    if args.commander and args.commander.startswith(SCRIPTED):
        return {**fields, "scripted": roster.check_commander(args.commander)}
    if args.commander:
        fields["commander"] = commander = rows.model_of(args.commander, args.commander_url)
        has_url = commander.base_url is not None or provider_of(commander.provider).base_url is not None
        if args.command == "hierarchical" and not has_url:  # FlightSpec rejects a commander with another --command
            raise UsageError(f"--commander {commander.title} needs --commander-url http://HOST:PORT/v1")
    return fields


def _of_episode(name: str) -> dict[str, Any]:
    """Return the FlightSpec field for an episode: the id of a shipped episode, or the record of another one."""
    if name in catalogue.all_ids():
        return {"episode": name}
    return {"record": json.loads(catalogue.load(name).to_json())}


def _of_world(name: str, instruction: str | None) -> dict[str, Any]:
    if name in maps.names():
        if not instruction:
            raise UsageError(f"'{name}' is a map, which has no instruction. Add --instruction, or name an episode")
        return {"map": name, "instruction": instruction}
    if instruction:
        raise UsageError("an episode has its own instruction. Leave --instruction out, or name a map with --world")
    return _of_episode(name)


def _limits(file: Path | None, base: Limits) -> Limits:
    return envelope.load(file, base) if file else base
