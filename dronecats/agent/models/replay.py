"""A recorded flight in a model's place: to each question the very reply that it had, with its latency."""

from dataclasses import dataclass
from typing import Literal

from dronecats.agent.latency import LONGEST_S
from dronecats.agent.models.model import Reply, Request
from foundation.errors import ModelError

_BROKEN_OFF = {  # by the reason of a flight's end
    "budget": "it was ended by its budget",
    "error": "it broke down",
    "rejected": "its model endpoint rejected every question",
    "interrupted": "it was interrupted",
    "takeover": "somebody took over",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedReply:
    """One reply as the log has it."""

    step: int  # number of the question among those about these drones
    drone: int  # the first of those that were asked for together
    reply: str
    latency_s: float = 0.0  # s of vehicle time
    tokens_in: int | None = None
    tokens_out: int | None = None
    finish: str | None = None
    served: str | None = None  # what answered, in the vendor's words
    tokens_cached: int | None = None
    tokens_reasoning: int | None = None
    endpoint: str | None = None  # whom a router had answer
    role: Literal["pilot", "commander"] = "pilot"  # whose it is; the steps of a commander are its exchanges


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRecording:
    """All that was said on a flight: a value, so that it can be flown again where its folder is not."""

    flight: str  # the episode folder it was read from, its name
    steps: tuple[LoggedReply, ...]
    to_the_cap: bool  # it flew to its end: a question without a reply was answered too late
    ended: str | None = None  # the reason in its log's end; None: it has none
    commander: str | None = None  # the name of who commanded; None: nobody did


class ReplayModel:
    """Answers from a recording, the questions of one role."""

    def __init__(self, recording: FlightRecording, role: Literal["pilot", "commander"] = "pilot") -> None:
        self.name = recording.commander or recording.flight if role == "commander" else recording.flight
        self._recording = recording
        self._steps = {(each.step, each.drone): each for each in recording.steps if each.role == role}
        self._late: set[int] = set()  # drones whose last question had no reply

    def ask(self, request: Request) -> Reply:
        """Return the recorded reply. Raises ModelError for a question that the flight did not have."""
        said = self._steps.get((request.step, request.drone))
        if said is not None:
            return Reply(
                said.reply,
                said.latency_s,
                said.tokens_in,
                said.tokens_out,
                finish=said.finish,
                served=said.served,
                tokens_cached=said.tokens_cached,
                tokens_reasoning=said.tokens_reasoning,
                endpoint=said.endpoint,
            )
        if not self._recording.to_the_cap or request.drone in self._late:
            asked = f"question {request.step} to the commander"
            if request.role == "pilot":
                asked = f"step {request.step} of drone {request.drone + 1}"
            why = _BROKEN_OFF.get(self._recording.ended or "", "this flight asks what that one did not")
            raise ModelError(f"the recording of {self._recording.flight} has no reply for {asked}: {why}")
        self._late.add(request.drone)
        return Reply("", LONGEST_S)

    def check(self) -> None:
        """It is there."""

    def close(self) -> None:
        """Nothing is open."""
