"""Converts a flight's spec to JSON, and reads it from a file or from the folder of a flight."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.replay import FlightRecording, LoggedReply, Role
from dronecats.flight.spec.flight_spec import LATENCY, FlightSpec
from foundation.conversion import convert
from foundation.errors import UsageError
from foundation.redaction import HIDDEN, redacted_url
from foundation.run_folder import layout
from foundation.run_folder.reading import episode_folder, exchanges, json_object, rows, run_configuration, truth
from foundation.run_folder.rows import Decision, End, Exchange
from foundation.typed_file import file_bytes, json_of
from hil.cameras.address import shown

BYTES_MAX = 4_000_000
DEPTH_MAX = 40  # levels of nested brackets in a file


def as_json(spec: FlightSpec) -> dict[str, Any]:
    """Return the complete spec as JSON values. To store it, use `as_redacted_json`: addresses may have API keys."""
    latency = {"latency": str(spec.latency), "latency_trace": spec.latency.trace}
    fields: dict[str, Any] = {}
    for name, value in msgspec.to_builtins(spec).items():
        fields |= latency if name == "latency" else {name: value}
    return fields


def as_redacted_json(spec: FlightSpec) -> dict[str, Any]:
    """Return the spec as JSON values for a file. Possible API keys and passwords in addresses are hidden."""
    model, commander, connected = spec.model, spec.commander, spec.connected
    if model and model.base_url:
        model = replace(model, base_url=redacted_url(model.base_url))
    if commander and commander.base_url:
        commander = replace(commander, base_url=redacted_url(commander.base_url))
    if connected and connected.camera:
        connected = replace(connected, camera=shown(connected.camera))
    return as_json(replace(spec, model=model, commander=commander, connected=connected))


def from_json(value: Any, where: str) -> FlightSpec:
    """Read a spec from JSON values. `where` names their source in errors. Raises UsageError for an invalid spec."""
    try:
        spec = _flight(value)
    except (msgspec.ValidationError, UsageError) as wrong:
        raise UsageError(f"{where} has no valid flight: {wrong}") from None
    if stray := _unknown(value, as_json(spec)):
        raise UsageError(f"{where} has no valid flight: '{stray}' is not known")
    return spec


def _flight(value: Any) -> FlightSpec:
    """Return the spec in JSON values. `latency` is a text; `latency_trace` has the numbers of a recorded latency."""
    if not isinstance(value, dict) or not {"latency", "latency_trace"} & value.keys():
        return convert(value, FlightSpec)
    text = convert(value.get("latency", LATENCY), str)
    trace = convert(value.get("latency_trace"), tuple[float, ...] | None)
    policy = msgspec.to_builtins(LatencyPolicy.parse(text, trace))
    fields = {name: value for name, value in value.items() if name != "latency_trace"}
    return convert({**fields, "latency": policy}, FlightSpec)


def read(path: Path) -> FlightSpec:
    """Return the spec in a file, which is a run.json or has only a spec. Raises UsageError with the file and reason."""
    where = f"--spec {path}"
    value = json_of(file_bytes(path, where, BYTES_MAX), where, BYTES_MAX, DEPTH_MAX)
    if isinstance(value, dict) and "versions" in value and "flight" not in value:
        raise UsageError(f"{where} is of an older version of dronecats, which did not write the flight")
    return from_json(value["flight"] if isinstance(value, dict) and "flight" in value else value, where)


def options_with_redacted_address(spec: FlightSpec) -> list[str]:
    """Return the options whose addresses have a part that was hidden when the spec was written."""
    addresses = {
        "--base-url": spec.model.base_url if spec.model else None,
        "--commander-url": spec.commander.base_url if spec.commander else None,
        "--camera": spec.connected.camera if spec.connected else None,
    }
    return [option for option, address in addresses.items() if address and HIDDEN in address]


def _unknown(value: Any, allowed: Any, path: str = "") -> str | None:
    """Return the first key of `value` that is not in `allowed`, as a path such as `model.name`."""
    if not (isinstance(value, dict) and isinstance(allowed, dict)):
        return None
    for key, inner in value.items():
        place = f"{path}.{key}" if path else str(key)
        if key not in allowed:
            return place
        if stray := _unknown(inner, allowed[key], place):
            return stray
    return None


def recorded(path: Path) -> FlightSpec:
    """Return the spec that repeats the flight in an episode folder, or in a run folder with one episode.

    The replies and their latencies come from the recording. The latency policy `real` becomes `measured`, because a
    replayed reply takes no time itself. Raises UsageError if the flight was not simulated or has no settings.
    """
    folder = episode_folder(path).resolve()
    configuration = run_configuration(folder.parent)
    if configuration is None or "flight" not in configuration:
        raise UsageError(f"{folder.parent / layout.RUN} does not have the flight, so it cannot be replayed")
    spec = from_json(configuration["flight"], str(folder.parent / layout.RUN))
    if spec.simulated is None:
        raise UsageError(f"{folder} was flown on a connected vehicle. To send its replies again: --pilot recorded:FILE")
    record = json_object(folder / layout.EPISODE)
    if record is None:
        raise UsageError(f"{folder / layout.EPISODE} cannot be read, so the episode is unknown")
    latency = LatencyPolicy.parse("measured") if spec.latency.real else spec.latency
    return replace(spec, episode=None, record=record, map=None, latency=latency, replay=_recording(folder))


def _recording(folder: Path) -> FlightRecording:
    steps: dict[int, LoggedReply] = {}
    questions: Counter[int] = Counter()  # first drone of a question → number of such questions so far
    served: dict[int, str] = {}  # first drone → name of the served model; a decision has the name only when it changes
    last_declared: tuple[Role, int] | None = None
    for decision in rows(folder / layout.DECISIONS, Decision):
        if decision.confirmed_by is not UNSET:  # a commander's confirmation; the reply is in commander.jsonl
            last_declared = ("commander", 0)
            continue
        if decision.reply is UNSET:
            raise UsageError(
                f"{folder / layout.DECISIONS} has no replies, because an older version of dronecats flew it"
            )
        if decision.served is not UNSET:
            served[decision.drone] = str(decision.served)
        if decision.step not in steps:  # every drone of a question has a decision with the same reply: keep the first
            where = {"step": questions[decision.drone], "drone": decision.drone, "served": served.get(decision.drone)}
            steps[decision.step] = _logged(decision, **where)
            questions[decision.drone] += 1
        if decision.declares:
            last_declared = ("pilot", steps[decision.step].drone)
    if not steps:
        raise UsageError(f"{folder} has no decision. Name a flight with decisions")
    ends = [row.reason for row in truth(folder) if isinstance(row, End)]
    commanded = exchanges(folder)
    return FlightRecording(
        flight=folder.name,
        steps=(*steps.values(), *_of_commander(commanded)),
        to_the_cap="cap" in ends,
        decided_by=last_declared if ends and ends[-1] == "decided" else None,
        ended=ends[-1] if ends else None,
        commander=commanded[0].model if commanded else None,
    )


def _of_commander(commanded: Sequence[Exchange]) -> Iterator[LoggedReply]:
    """Yield the replies of the commander. Exchanges without a reply are skipped."""
    served: str | None = None  # name of the served model; an exchange has the name only when it changes
    for exchange in commanded:
        served = served if exchange.served is UNSET else str(exchange.served)
        if exchange.reply is not None:
            yield _logged(exchange, step=exchange.number, drone=0, served=served, role="commander")


def _logged(row: Decision | Exchange, **others: Any) -> LoggedReply:
    """Return the reply in a row. A value that the row does not have is the default of `LoggedReply`."""
    names = ("reply", "latency_s", "tokens_in", "tokens_out", "finish", "tokens_cached", "tokens_reasoning", "endpoint")
    values = {name: value for name in names if (value := getattr(row, name, None)) is not None and value is not UNSET}
    return LoggedReply(**values, **others)
