"""What becomes of pictures between the camera and who decides on them, on purpose: late, lost, stale, seldom.

All of it in vehicle time, and drawn once for each question and drone from the seed, the same in lockstep and in real
time. A picture keeps the time at which it was taken, so that what is decided on it counts from where it was taken.
"""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dronecats.agent.latency import Question
from foundation.camera import Camera, Frame

AGAIN_S = 0.1  # vehicle s after which a picture that does not come is asked for again, at least
PICTURES = 6  # stream of draws, beside those of `latency`
CLOSE_S = 1e-9  # s

Fetch = Callable[[Callable[[], Frame]], Generator[None, None, Frame]]  # what may take long, while time passes


@dataclass(frozen=True, slots=True)
class PictureLoss:
    """What is drawn for one question's picture."""

    stale: bool  # it is the one of the question before
    lost: int  # how many never come before one does


class PicturePath:
    """The way from a camera to the deciders of one flight."""

    def __init__(
        self,
        *,
        delay_s: float = 0.0,
        dropped: float = 0.0,
        stale: float = 0.0,
        rate_hz: float | None = None,
        recall: Callable[[int, int], Frame] | None = None,
    ) -> None:
        """Take what `FrameFaults` says.

        `recall` returns the frame of a time (µs, vehicle clock) and drone that has passed; `rate_hz` wants it.
        """
        self._delay_s, self._dropped, self._stale = delay_s, dropped, stale
        self._rate_hz, self._recall = rate_hz, recall
        self._got: dict[tuple[int, int], Frame] = {}  # (first of those that are asked together, drone) → the last one
        self._numbers: dict[tuple[int, int], int] = {}  # likewise, of a picture that is one of a rate
        self.held_s = 0.0  # vehicle s for which the pictures of the newest question were held back

    def drawn(self, question: Question, drone: int) -> PictureLoss:
        """Return what becomes of a question's picture of a drone: nothing else moves it, and levels are nested."""
        numbers = np.random.default_rng((*question.seed, question.step, question.drone, drone, PICTURES))
        stale = float(numbers.random()) < self._stale
        lost = 0
        while float(numbers.random()) < self._dropped:
            lost += 1
        return PictureLoss(stale, lost)

    def frames(
        self,
        camera: Camera,
        question: Question,
        drones: Sequence[int],
        now_s: Callable[[], float],
        t0_us: int,
        fetch: Fetch,
    ) -> Generator[None, None, list[Frame]]:
        """Return the frame of each drone on which a question is asked; yield while they come. Raises CameraError.

        `now_s` and `t0_us` are the episode's clock.
        """
        self.held_s = 0.0
        coming = {drone: self._frame(camera, question, drone, now_s, t0_us, fetch) for drone in drones}
        came: dict[int, Frame] = {}
        while True:
            for drone in [each for each in drones if each not in came]:
                try:
                    next(coming[drone])
                except StopIteration as done:
                    came[drone] = done.value
            if len(came) == len(coming):
                return [came[drone] for drone in drones]
            yield

    def _frame(
        self, camera: Camera, question: Question, drone: int, now_s: Callable[[], float], t0_us: int, fetch: Fetch
    ) -> Generator[None, None, Frame]:
        whose, fate = (question.drone, drone), self.drawn(question, drone)
        if fate.stale and whose in self._got:
            return self._got[whose]
        asked_s = now_s()
        if self._rate_hz is None:
            taken_s = asked_s + fate.lost * max(self._delay_s, AGAIN_S)
            take = partial(camera.newest, drone)
        else:
            number = max(0, math.floor((asked_s - self._delay_s) * self._rate_hz + CLOSE_S)) + fate.lost
            if number == self._numbers.get(whose):
                return self._got[whose]
            self._numbers[whose] = number
            taken_s = number / self._rate_hz
            assert self._recall is not None  # whoever takes pictures at a rate can say what was seen a moment ago
            take = partial(self._recall, t0_us + round(taken_s * 1e6), drone)
        yield from _until(taken_s, now_s)
        waited_s = now_s() - asked_s
        frame = yield from fetch(take)
        came_s = now_s()
        yield from _until((frame.time_us - t0_us) / 1e6 + self._delay_s, now_s)
        self._got[whose] = frame
        self.held_s = max(self.held_s, waited_s + now_s() - came_s)
        return frame


def _until(time_s: float, now_s: Callable[[], float]) -> Generator[None, None, None]:
    while now_s() < time_s - CLOSE_S:
        yield
