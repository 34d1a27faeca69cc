"""A simulated flight whose pilot is another harness, such as Inspect. The harness may answer at any time.

The flight runs in lockstep: the vehicle's clock stands still from a question to its answer. Only the latency policy
determines the vehicle time that an answer takes.
"""

import json
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.agent.models.model import Model, Reply, Request
from dronecats.flight.run.fly import settings
from dronecats.flight.run.simulated import SimulatedFlight
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from foundation.camera import WIDTH_MAX, CameraModel
from foundation.errors import ModelError, UsageError
from foundation.protocol import ACTIONS, GO, ROTATE
from foundation.run_folder import folder as folders
from foundation.run_folder.reading import result_of
from foundation.run_folder.results import Result

KINDS = ACTIONS  # a harness names an action by its index in this tuple
_CAMERA = CameraModel()
PICTURE_SHAPE = (_CAMERA.height * WIDTH_MAX // _CAMERA.width, WIDTH_MAX, 3)  # as models get it: height, width, RGB
_CREATING = threading.Lock()  # held to create or read run.json, because flights of a run may begin together


def picture(jpeg: bytes) -> NDArray[np.uint8]:
    """Return a JPEG as (height, width, 3) RGB."""
    decoded = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB), np.uint8)


def reply(kind: int, point: Sequence[float], depth_m: float, angle_deg: float) -> str:
    """Return the JSON reply of an action, without the fields that its kind does not need.

    `point`: (x, y), 0 … 1000 from the picture's upper left corner. Raises ValueError for an unknown kind.
    """
    if kind not in range(len(KINDS)):
        raise ValueError(f"the kind of an action is 0 … {len(KINDS) - 1}, got {kind}")
    fields: dict[str, object] = {"action": KINDS[kind]}
    if KINDS[kind] == GO:
        fields |= {"point": [float(point[0]), float(point[1])], "depth_m": float(depth_m)}
    elif KINDS[kind] == ROTATE:
        fields |= {"angle_deg": float(angle_deg)}
    return json.dumps(fields)


class Abandoned(KeyboardInterrupt):
    """The caller stops answering. Like Ctrl-C, this ends the flight without a score."""


class _OutsideModel(Model):
    """The model of an outside flight. It passes each question to the harness and waits for the answer."""

    def __init__(self, name: str, put_question: Callable[[Request], None]) -> None:
        self.name = name
        self.answers: queue.SimpleQueue[Reply | BaseException] = queue.SimpleQueue()
        self._put_question = put_question

    def ask(self, request: Request) -> Reply:
        start_s = time.monotonic()
        self._put_question(request)
        answer = self.answers.get()
        if isinstance(answer, BaseException):
            raise answer
        return replace(answer, latency_s=time.monotonic() - start_s)


class OutsideFlight:
    """One flight in lockstep. The caller alternates `question` and `answer` until there is no further question."""

    def __init__(self, spec: FlightSpec, run: Path) -> None:
        """Begin the flight, in a new folder of the run. Raises UsageError if `spec` has no harness or no simulation."""
        if spec.outside is None:
            raise UsageError("the spec has no `outside`. Set it to the name of the harness")
        self._folder_lock = ExitStack()  # locks the folder until the flight is over
        self._events: queue.SimpleQueue[Request | dict[str, Any] | BaseException] = queue.SimpleQueue()
        self._model = _OutsideModel(spec.outside.name, self._events.put)
        self._flight = look_up(spec, outside=self._model)
        if self._flight.record is None or self._flight.spec.simulated is None:
            raise UsageError("a flight that is flown from outside is a simulated episode")
        self._setup = SimulatedFlight(self._flight)
        configuration = settings(self._flight, self._flight.camera)
        created = folders.create(run, spec.pilot_name, self._setup.episode, configuration)
        with _CREATING:
            self.folder = self._folder_lock.enter_context(created)
        self._waiting = False  # whether a question is unanswered
        self._ended: dict[str, Any] | BaseException | None = None
        self._thread = threading.Thread(target=self._fly, name="flight", daemon=True)
        self._thread.start()

    @property
    def instruction(self) -> str:
        return self._flight.instruction

    def question(self) -> Request | None:
        """Return the next question; None: the flight is over. Raises RuntimeError while a question is unanswered."""
        if self._waiting:
            raise RuntimeError("the question before has not been answered")
        if self._ended is not None:
            return None
        event = self._events.get()
        if isinstance(event, Request):
            self._waiting = True
            return event
        self._ended = event
        self._thread.join()
        return None

    def answer(self, text: str, tokens_in: int | None = None, tokens_out: int | None = None) -> None:
        """Answer the open question as a model would: with one JSON action. Raises RuntimeError without a question."""
        self._hand_back(Reply(text, 0.0, tokens_in, tokens_out))

    def result(self) -> Result:
        """Return the result. Raises the error that ended the flight, and RuntimeError if it is not over."""
        if self._ended is None:
            raise RuntimeError("the flight is not over")
        if isinstance(self._ended, BaseException):
            raise self._ended
        return result_of(self._ended, str(self.folder))

    def fail(self, why: str) -> None:
        """End the flight with an infrastructure error, in place of an answer."""
        self._hand_back(ModelError(why))

    def close(self) -> None:
        """Abort the flight if it is not over."""
        while self._ended is None:
            if self._waiting:
                self._hand_back(Abandoned())
            self.question()

    def _hand_back(self, answer: Reply | BaseException) -> None:
        if not self._waiting:
            raise RuntimeError("no question is open. Read the next one first")
        self._waiting = False
        self._model.answers.put(answer)

    def _fly(self) -> None:
        try:
            self._events.put(self._setup.fly_in(self.folder, lambda line: None))
        except BaseException as error:
            self._events.put(error)
        finally:
            self._folder_lock.close()
