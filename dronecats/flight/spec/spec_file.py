"""A flight as JSON: whole, for whoever flies it, and as it may stand in a file."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from dronecats.agent.latency import LatencyPolicy
from dronecats.flight.spec.flight_spec import LATENCY, FlightSpec
from foundation.errors import UsageError
from foundation.redaction import HIDDEN, redacted_url
from hil.cameras.address import shown

BYTES_MAX = 4_000_000


def as_json(spec: FlightSpec) -> dict[str, Any]:
    """Return the whole spec as JSON values. It may hold a key, in an address: for a pipe, never for a file."""
    latency = {"latency": str(spec.latency), "latency_trace": spec.latency.trace}
    values = ((name, value) for name, value in msgspec.to_builtins(spec).items())
    return {
        key: each for name, value in values for key, each in (latency if name == "latency" else {name: value}).items()
    }


def as_kept(spec: FlightSpec) -> dict[str, Any]:
    """Return the spec as JSON values for a file: without what may be a key or a password in an address."""
    model, commander, connected = spec.model, spec.commander, spec.connected
    if model and model.base_url:
        model = replace(model, base_url=redacted_url(model.base_url))
    if commander and commander.base_url:
        commander = replace(commander, base_url=redacted_url(commander.base_url))
    if connected and connected.camera:
        connected = replace(connected, camera=shown(connected.camera))
    return as_json(replace(spec, model=model, commander=commander, connected=connected))


def from_json(value: Any, where: str) -> FlightSpec:
    """Return the spec that JSON values hold, `where` naming them. Raises UsageError for what is none."""
    try:
        spec = _flight(value)
    except (msgspec.ValidationError, UsageError) as wrong:
        raise UsageError(f"{where} holds no flight: {wrong}") from None
    if stray := _unknown(value, as_json(spec)):
        raise UsageError(f"{where} holds no flight: '{stray}' is not known")
    return spec


def _flight(value: Any) -> FlightSpec:
    """Return the spec that JSON values hold: of its latency the text, and the numbers of a recorded one beside it."""
    if not isinstance(value, dict) or not {"latency", "latency_trace"} & value.keys():
        return msgspec.convert(value, FlightSpec)
    text = msgspec.convert(value.get("latency", LATENCY), str)
    trace = msgspec.convert(value.get("latency_trace"), tuple[float, ...] | None)
    policy = msgspec.to_builtins(LatencyPolicy.parse(text, trace))
    others = {name: each for name, each in value.items() if name != "latency_trace"}
    return msgspec.convert({**others, "latency": policy}, FlightSpec)


def read(path: Path) -> FlightSpec:
    """Return the spec in a file: a run.json, or a spec alone. Raises UsageError naming the file and the reason."""
    try:
        data = path.read_bytes()
        if len(data) > BYTES_MAX:
            raise UsageError(f"--spec {path} is longer than a flight can be")
        value = json.loads(data)
    except OSError as error:
        raise UsageError(f"--spec {path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"--spec {path} is not JSON: {error}") from None
    if isinstance(value, dict) and "versions" in value and "flight" not in value:
        raise UsageError(f"--spec {path} is of a run that an earlier version flew, which kept no flight in it")
    return from_json(value["flight"] if isinstance(value, dict) and "flight" in value else value, f"--spec {path}")


def hidden(spec: FlightSpec) -> list[str]:
    """Return which addresses of a spec were hidden when it was kept, as the options that give them anew."""
    addresses = {
        "--base-url": spec.model.base_url if spec.model else None,
        "--commander-url": spec.commander.base_url if spec.commander else None,
        "--camera": spec.connected.camera if spec.connected else None,
    }
    return [option for option, address in addresses.items() if address and HIDDEN in address]


def _unknown(value: Any, known: Any, path: str = "") -> str | None:
    """Return the first key of `value`, with its place, that `known` has not."""
    if not (isinstance(value, dict) and isinstance(known, dict)):
        return None
    for key, inner in value.items():
        place = f"{path}.{key}" if path else str(key)
        if key not in known:
            return place
        if found := _unknown(inner, known[key], place):
            return found
    return None
