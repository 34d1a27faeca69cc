"""A flight that was flown, read from its folder, to be flown again."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from msgspec import UNSET

from dronecats.agent.models.replay import FlightRecording, LoggedReply
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import from_json
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import episode_folder, exchanges, json_object, rows, run_configuration, truth
from foundation.run_folder.rows import Decision, End, Exchange


def recorded(path: Path) -> FlightSpec:
    """Return the flight in an episode folder, or in a run's only one, with its recording in the pilot's place.

    Raises UsageError where that is no flight in simulation, or does not say how it was flown.
    """
    folder = episode_folder(path).resolve()
    configuration = run_configuration(folder.parent)
    if configuration is None or "flight" not in configuration:
        raise UsageError(f"{folder.parent / layout.RUN} does not say what was flown, so it cannot be flown again")
    spec = from_json(configuration["flight"], str(folder.parent / layout.RUN))
    if spec.simulated is None:
        raise UsageError(f"{folder} was flown on a vehicle of yours; --pilot recorded:FILE says its replies again")
    record = json_object(folder / layout.EPISODE)
    if record is None:
        raise UsageError(f"{folder / layout.EPISODE} cannot be read; without it nobody knows what was flown")
    return replace(spec, episode=None, record=record, map=None, replay=_recording(folder))


def _recording(folder: Path) -> FlightRecording:
    steps: dict[int, LoggedReply] = {}
    asked: Counter[int] = Counter()  # by the first of the drones that are asked for together
    served: dict[int, str] = {}  # likewise; a decision tells it when it changes
    for said in rows(folder / layout.DECISIONS, Decision):
        if said.confirmed_by is not UNSET:  # the commander's, whose reply stands with its exchange
            continue
        if said.reply is UNSET:
            raise UsageError(f"{folder / layout.DECISIONS} holds no replies; an older version flew it")
        if said.served is not UNSET:
            served[said.drone] = str(said.served)
        if said.step not in steps:  # of those that were asked for together, the first
            steps[said.step] = LoggedReply(
                step=asked[said.drone],
                drone=said.drone,
                reply=str(said.reply),
                latency_s=said.latency_s or 0.0,
                tokens_in=said.tokens_in,
                tokens_out=said.tokens_out,
                finish=None if said.finish is UNSET else str(said.finish),
                served=served.get(said.drone),
                tokens_cached=None if said.tokens_cached is UNSET else said.tokens_cached,
                tokens_reasoning=None if said.tokens_reasoning is UNSET else said.tokens_reasoning,
                endpoint=None if said.endpoint is UNSET else str(said.endpoint),
            )
            asked[said.drone] += 1
    if not steps:
        raise UsageError(f"{folder} holds no decision; name a flight that took steps")
    ends = [row.reason for row in truth(folder) if isinstance(row, End)]
    commanded = exchanges(folder)
    return FlightRecording(
        flight=folder.name,
        steps=(*steps.values(), *_of_commander(commanded)),
        to_the_cap="cap" in ends,
        ended=ends[-1] if ends else None,
        commander=commanded[0].model if commanded else None,
    )


def _of_commander(commanded: Sequence[Exchange]) -> Iterator[LoggedReply]:
    """Yield the replies of the exchanges that had one."""
    served: str | None = None  # an exchange tells it when it changes
    for said in commanded:
        served = served if said.served is UNSET else str(said.served)
        if said.reply is not None:
            yield LoggedReply(
                step=said.number,
                drone=0,
                reply=said.reply,
                latency_s=said.latency_s or 0.0,
                tokens_in=said.tokens_in,
                tokens_out=said.tokens_out,
                served=served,
                role="commander",
            )
