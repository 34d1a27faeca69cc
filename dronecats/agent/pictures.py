"""Declared disturbances of pictures between the camera and `loop.Decider`: delay, loss, staleness, low rate.

All times are vehicle time. The seed, the question and the drone determine each random draw, so the draws are the same
in lockstep and in real time. A picture keeps the time at which it was taken, and an action counts from the drone's pose
at that time.
"""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dronecats.agent.latency import Question
from foundation.camera import Camera, Frame

AGAIN_S = 0.1  # vehicle s, the shortest time before a lost picture is requested again
PICTURES = 6  # number of the random stream of these draws; `latency.py` has the numbers of the other streams
CLOSE_S = 1e-9  # s, tolerance of comparisons

Fetch = Callable[[Callable[[], Frame]], Generator[None, None, Frame]]  # runs a slow call, and yields until it returns


@dataclass(frozen=True, slots=True)
class PictureLoss:
    """The drawn disturbances of the picture of one question."""

    stale: bool  # the question gets the previous question's picture
    lost: int  # number of pictures that are lost before one arrives


class PicturePath:
    """Passes the pictures of a camera to the deciders of one flight, with the disturbances."""

    def __init__(
        self,
        *,
        delay_s: float = 0.0,
        dropped: float = 0.0,
        stale: float = 0.0,
        rate_hz: float | None = None,
        recall: Callable[[int, int], Frame] | None = None,
    ) -> None:
        """Set the disturbances (`dronecats.flight.spec.disturbances.FrameFaults`).

        `recall` returns the frame of a drone at a past time (µs, vehicle clock); `rate_hz` needs it.
        """
        self._delay_s, self._dropped, self._stale = delay_s, dropped, stale
        self._rate_hz, self._recall = rate_hz, recall
        self._got: dict[tuple[int, int], Frame] = {}  # (first drone of a question, drone) → last frame of `drone`
        self._numbers: dict[tuple[int, int], int] = {}  # same key → n, for a frame taken at n / `rate_hz` s
        # first drone of a question → vehicle s by which disturbances delayed the pictures of its newest question
        self.held_s: dict[int, float] = {}

    def drawn(self, question: Question, drone: int) -> PictureLoss:
        """Return the draw for the picture of a question and drone.

        The same question always draws the same numbers. So a higher share only adds stale or lost pictures.
        """
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
        cap_s: float,
        t0_us: int,
        fetch: Fetch,
    ) -> Generator[None, None, list[Frame] | None]:
        """Return the frame of each drone for a question; yield until all have arrived. Raises CameraError.

        Returns None if the episode ends at `cap_s` before all have arrived.
        `now_s` returns the vehicle seconds since the episode began, at `t0_us` of the vehicle's clock.
        """
        self.held_s[question.drone] = 0.0
        coming = {drone: self._frame(camera, question, drone, now_s, t0_us, fetch) for drone in drones}
        came: dict[int, Frame] = {}
        while True:
            for drone in [number for number in drones if number not in came]:
                try:
                    next(coming[drone])
                except StopIteration as done:
                    came[drone] = done.value
            if len(came) == len(coming):
                return [came[drone] for drone in drones]
            if now_s() >= cap_s:
                return None
            yield

    def _frame(
        self, camera: Camera, question: Question, drone: int, now_s: Callable[[], float], t0_us: int, fetch: Fetch
    ) -> Generator[None, None, Frame]:
        key, fate = (question.drone, drone), self.drawn(question, drone)
        if fate.stale and key in self._got:
            return self._got[key]
        start_s = now_s()
        if self._rate_hz is None:
            taken_s = start_s + fate.lost * max(self._delay_s, AGAIN_S)
            take = partial(camera.newest, drone)
        else:
            number = max(0, math.floor((start_s - self._delay_s) * self._rate_hz + CLOSE_S)) + fate.lost
            if number == self._numbers.get(key):
                return self._got[key]
            self._numbers[key] = number
            taken_s = number / self._rate_hz
            assert self._recall is not None  # required with a rate
            take = partial(self._recall, t0_us + round(taken_s * 1e6), drone)
        yield from _until(taken_s, now_s)
        waited_s = now_s() - start_s
        frame = yield from fetch(take)
        came_s = now_s()
        yield from _until((frame.time_us - t0_us) / 1e6 + self._delay_s, now_s)
        self._got[key] = frame
        self.held_s[question.drone] = max(self.held_s[question.drone], waited_s + now_s() - came_s)
        return frame


def _until(time_s: float, now_s: Callable[[], float]) -> Generator[None, None, None]:
    while now_s() < time_s - CLOSE_S:
        yield
