"""Models that answer from records: a recorded flight, and a cache file of replies."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import msgspec

from dronecats.agent.latency import LONGEST_S
from dronecats.agent.models.model import Model, Reply, Request, WrappedModel
from foundation.conversion import convert
from foundation.errors import InfrastructureError, ModelError
from foundation.files import FileKind, SqliteFile

_BROKEN_OFF = {  # texts for error messages, by the reason for which the recorded flight ended
    "budget": "its budget was spent",
    "error": "it ended in an error",
    "rejected": "its model endpoint rejected the questions",
    "interrupted": "it was interrupted",
    "takeover": "a person or the autopilot took over",
}


Role = Literal["pilot", "commander"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedReply:
    """One reply in the log. None stands for a value that the log does not have."""

    step: int  # number of the question, from 0; each first drone has its own count
    drone: int  # first drone of the question
    reply: str
    latency_s: float = 0.0  # s of vehicle time
    tokens_in: int | None = None
    tokens_out: int | None = None
    finish: str | None = None
    served: str | None = None  # the model that answered, as the vendor names it
    tokens_cached: int | None = None
    tokens_reasoning: int | None = None
    endpoint: str | None = None  # the provider that a router chose
    role: Role = "pilot"  # for a commander, `step` is the number of the question to it


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRecording:
    """All replies of a flight as data, so that the flight can be repeated without its folder."""

    flight: str  # name of the episode folder
    steps: tuple[LoggedReply, ...]
    to_the_cap: bool  # the flight lasted until its time limit, which may have come before the reply to an open question
    decided_by: tuple[Role, int] | None = None  # role and first drone of the question whose reply ended the flight
    ended: str | None = None  # the reason in the End row of the flight's log; None: no such row
    commander: str | None = None  # name of the commander; None: there was none


class ReplayModel(Model):
    """Answers the questions of one role with the replies of a recorded flight, and their latencies."""

    def __init__(self, recording: FlightRecording, role: Role = "pilot") -> None:
        self.name = recording.commander or recording.flight if role == "commander" else recording.flight
        self._recording, self._role = recording, role
        self._steps = {(reply.step, reply.drone): reply for reply in recording.steps if reply.role == role}
        self._late: set[int] = set()  # drones whose question has already got an empty reply, see `ask`

    def ask(self, request: Request) -> Reply:
        """Return the recorded reply. Raises ModelError for a question that the flight did not have.

        If the recorded flight may have ended before the reply, return an empty reply with the latency LONGEST_S.
        """
        logged = self._steps.get((request.step, request.drone))
        if logged is not None:
            return Reply(
                logged.reply,
                logged.latency_s,
                logged.tokens_in,
                logged.tokens_out,
                finish=logged.finish,
                served=logged.served,
                tokens_cached=logged.tokens_cached,
                tokens_reasoning=logged.tokens_reasoning,
                endpoint=logged.endpoint,
            )
        if not self._was_open(request.drone) or request.drone in self._late:
            question = f"question {request.step} to the commander"
            if request.role == "pilot":
                question = f"step {request.step} of drone {request.drone + 1}"
            why = _BROKEN_OFF.get(
                self._recording.ended or "", "this flight has questions that the recorded flight did not have"
            )
            raise ModelError(f"the recording of {self._recording.flight} has no reply for {question}: {why}")
        self._late.add(request.drone)
        return Reply("", LONGEST_S)

    def _was_open(self, drone: int) -> bool:
        """Return whether the recorded flight may have ended while a question to `drone` was open."""
        decided_by = self._recording.decided_by
        return self._recording.to_the_cap or (decided_by is not None and decided_by != (self._role, drone))


KIND = FileKind(
    "cache",
    0x44434341,
    1,
    "CREATE TABLE replies (question TEXT PRIMARY KEY, model TEXT NOT NULL, reply TEXT NOT NULL) STRICT;",
)
_READ = "SELECT reply FROM replies WHERE question = ?"


class ReplyCache:
    """An open cache file: replies, without secrets, by the fingerprint of their question."""

    def __init__(self, path: Path) -> None:
        """Raises UsageError for an unusable file."""
        self._file = SqliteFile(path, KIND)

    def reply(self, question: str) -> Reply | None:
        """Return the reply to a question; None for a new question. Raises InfrastructureError."""
        row = self._file.row(_READ, question)
        return _reply(str(row[0])) if row else None

    def keep(self, question: str, model: str, reply: Reply) -> Reply:
        """Store a reply unless the question has one, and return the stored reply. Raises InfrastructureError."""
        stored = asdict(replace(reply, waited_s=0.0, lost=(0, 0)))
        text = json.dumps(stored)  # non-ASCII is escaped, because half a surrogate pair cannot be encoded as UTF-8
        with self._file.transaction() as db:
            db.execute("INSERT OR IGNORE INTO replies VALUES (?, ?, ?)", (question, model, text))
            (kept,) = db.execute(_READ, (question,)).fetchone()
        return reply if kept == text else _reply(kept)

    @property
    def is_empty(self) -> bool:
        """True when the file holds no reply. Raises InfrastructureError."""
        return self._file.row("SELECT 1 FROM replies LIMIT 1") is None

    def close(self) -> None:
        self._file.close()


def _reply(text: str) -> Reply:
    try:
        return convert(json.loads(text), Reply)
    except (ValueError, msgspec.ValidationError):
        raise InfrastructureError(
            "the cache has an entry that is not a reply. Move the file away, or name another file"
        ) from None


class CachedModel(WrappedModel):
    """Sends only new questions to a model. A stored reply comes at once and states its old latency."""

    def __init__(self, model: Model, fingerprint: Callable[[Request], str], cache: ReplyCache) -> None:
        super().__init__(model)
        self._fingerprint, self._cache = fingerprint, cache

    def ask(self, request: Request) -> Reply:
        """Return the reply. Raises ModelError, and InfrastructureError for an unusable cache."""
        question = self._fingerprint(request)
        if (kept := self._cache.reply(question)) is not None:
            return kept
        return self._cache.keep(question, self.name, self._model.ask(request))
