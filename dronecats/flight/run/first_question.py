"""One small question to each model before anything takes off: a wrong key or address is found on the ground."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.models.endpoint import GIVE_UP_S, RetryPolicy
from dronecats.agent.models.ledger import Spent, spent_on
from dronecats.agent.models.model import Request, ending_reason
from dronecats.agent.models.probe import marked_picture
from dronecats.agent.models.replay import ReplyCache
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from dronecats.flight.run.accounts import book, is_spent
from dronecats.flight.spec.flight_spec import Accounts, FlightSpec
from foundation.errors import ModelRejectedError, UsageError
from foundation.run_folder import folder as folders

Say = Callable[[str], None]

TEXT = 'The picture does not matter. Answer with this JSON object and nothing else: {"action": "think"}'


@dataclass(frozen=True, slots=True)
class _Answered:
    """What a first question has cost, and on which accounts."""

    model: str  # PROVIDER/NAME
    spent: Spent
    accounts: Accounts


class FirstQuestions:
    """The first questions of some flights, one for each model. They are no decisions, and their cost is booked."""

    def __init__(self, flights: Iterable[FlightSpec], run: Path | None, say: Say) -> None:
        """`run` is the folder with the ledger; None: a new one, with nothing spent."""
        self._flights, self._run, self._say = list(flights), run, say
        self._answered: list[_Answered] = []

    def ask(self) -> None:
        """Ask each model once. Raises UsageError where it rejects every question, ModelError where none answers.

        Nothing is asked of a replay, of a run whose limit is spent, or where a cache holds replies already.
        """
        asked: list[ModelSpec] = []
        for flight in self._flights:
            for model in () if flight.replay else filter(None, (flight.model, flight.commander)):
                if model not in asked and not is_spent(flight.accounts, self._run) and not _is_cached(flight.accounts):
                    asked.append(model)
                    self._answered.append(self._ask(model, flight))

    def book(self, run: Path) -> None:
        """Book what they have cost with the run in a folder. Raises InfrastructureError."""
        for answered in self._answered:
            book(answered.model, answered.spent, answered.accounts, run)

    def _ask(self, spec: ModelSpec, flight: FlightSpec) -> _Answered:
        self._say(f"{spec.title}: one small question before take-off …")
        patience_s = GIVE_UP_S if flight.patience_s is None else min(flight.patience_s, GIVE_UP_S)
        model, request = open_model(spec, RetryPolicy(give_up_s=patience_s)), Request(TEXT, (marked_picture(),), False)
        try:
            model.check()
            reply = model.ask(request)
        except ModelRejectedError as rejected:
            raise UsageError(f"{rejected}; nothing was flown") from None
        finally:
            model.close()
        why = ending_reason(reply.finish, reply.tokens_out)
        self._say(f"{spec.title}: answered in {reply.latency_s:.2f} s{f', {why}' if why else ''}")
        return _Answered(spec.title, spent_on(spec, request, reply), flight.accounts)


@contextmanager
def asked_folder(spec: FlightSpec, out: Path | None, episode: str, found: dict[str, Any], say: Say) -> Iterator[Path]:
    """Give the folder of a flight, made once its models have answered their first question.

    Arguments and errors as `folders.create` has them; raises ModelError too.
    """
    questions = FirstQuestions([spec], out, say)
    with folders.create(out, spec.pilot_name, episode, found, questions.ask) as folder:
        questions.book(folder.parent)
        yield folder


def _is_cached(accounts: Accounts) -> bool:
    """Return whether a cache holds replies: it may answer the whole flight, with no endpoint there."""
    if accounts.cache is None:
        return False
    cache = ReplyCache(Path(accounts.cache))
    try:
        return not cache.is_empty
    finally:
        cache.close()
