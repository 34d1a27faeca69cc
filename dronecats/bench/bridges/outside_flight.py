"""A simulated flight whose pilot is asked from outside: question by question, at the caller's own pace.

In lockstep the vehicle's clock stands still between a question and its answer, however long that takes; the flight's
latency policy alone says what an answer costs.
"""

import queue
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.models.model import Reply, Request
from dronecats.flight.run.settings import settings
from dronecats.flight.run.simulated import SimulatedFlight
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from foundation.errors import ModelError, UsageError
from foundation.run_folder import folder as folders
from foundation.run_folder.reading import result_of
from foundation.run_folder.results import Result

_CREATING = threading.Lock()  # flights of one run that begin at once find or make its run.json one after the other


class Abandoned(KeyboardInterrupt):
    """Nobody answers any more. Like a Ctrl-C it ends the flight, which is nobody's failure."""


@dataclass(frozen=True, slots=True)
class OutsideReply:
    """What the caller says to a question."""

    text: str  # a reply as a model would give it: one JSON action
    tokens_in: int | None = None
    tokens_out: int | None = None


class _Handed:
    """The model of such a flight: it hands each question out, and waits for what is handed back."""

    def __init__(self, name: str, ask_out: Callable[[Request], None]) -> None:
        self.name = name
        self.answers: queue.SimpleQueue[OutsideReply | BaseException] = queue.SimpleQueue()
        self._ask_out = ask_out

    def ask(self, request: Request) -> Reply:
        asked_s = time.monotonic()
        self._ask_out(request)
        answer = self.answers.get()
        if isinstance(answer, BaseException):
            raise answer
        return Reply(answer.text, time.monotonic() - asked_s, answer.tokens_in, answer.tokens_out)

    def check(self) -> None:
        pass

    def close(self) -> None:
        pass


class OutsideFlight:
    """One flight in lockstep. `question` and `answer` take turns until there is no question any more."""

    def __init__(self, spec: FlightSpec, run: Path) -> None:
        """Begin to fly into a folder of the run. Raises UsageError for a spec that nobody outside can fly."""
        if spec.outside is None:
            raise UsageError("a flight that is flown from outside names in `outside` by whom")
        self._held = ExitStack()  # the folder, until the flight is over
        self._told: queue.SimpleQueue[Request | dict[str, Any] | BaseException] = queue.SimpleQueue()
        self._handed = _Handed(spec.outside.name, self._told.put)
        self._flight = look_up(spec, outside=self._handed)
        if self._flight.record is None or self._flight.spec.simulated is None:
            raise UsageError("a flight that is flown from outside is a simulated episode")
        self._setup = SimulatedFlight(self._flight)
        found = settings(self._flight, self._flight.camera)
        created = folders.create(run, spec.pilot_name, self._setup.episode, found)
        with _CREATING:
            self.folder = self._held.enter_context(created)
        self._waiting = False  # whether a question is out
        self._ended: dict[str, Any] | BaseException | None = None
        self._thread = threading.Thread(target=self._fly, name="flight", daemon=True)
        self._thread.start()

    @property
    def instruction(self) -> str:
        """What the pilot is told to do."""
        return self._flight.instruction

    def question(self) -> Request | None:
        """Return the next question, None when the flight is over. Raises RuntimeError while one is unanswered."""
        if self._waiting:
            raise RuntimeError("the question before has not been answered")
        if self._ended is not None:
            return None
        told = self._told.get()
        if isinstance(told, Request):
            self._waiting = True
            return told
        self._ended = told
        self._thread.join()
        return None

    def answer(self, answer: OutsideReply) -> None:
        """OutsideReply the question that is out. Raises RuntimeError when none is."""
        self._hand_back(answer)

    def result(self) -> Result:
        """Return what came of a flight that is over. Raises what broke it, RuntimeError while it goes on."""
        if self._ended is None:
            raise RuntimeError("the flight is not over")
        if isinstance(self._ended, BaseException):
            raise self._ended
        return result_of(self._ended, str(self.folder))

    def fail(self, why: str) -> None:
        """Tell instead of an answer why there is none: an error of the infrastructure, which ends the flight."""
        self._hand_back(ModelError(why))

    def close(self) -> None:
        """End the flight where it is, if it is not over."""
        while self._ended is None:
            if self._waiting:
                self._hand_back(Abandoned())
            self.question()

    def _hand_back(self, what: OutsideReply | BaseException) -> None:
        if not self._waiting:
            raise RuntimeError("there is no question to answer")
        self._waiting = False
        self._handed.answers.put(what)

    def _fly(self) -> None:
        try:
            self._told.put(self._setup.fly_in(self.folder, lambda line: None))
        except BaseException as error:
            self._told.put(error)
        finally:
            self._held.close()
