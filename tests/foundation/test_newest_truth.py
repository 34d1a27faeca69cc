"""One thread reads the newest truth while another thread feeds it."""

import threading
from collections import deque
from collections.abc import Iterator

import pytest

from foundation.mavlink import Packer
from foundation.truth import NewestTruth, TruthSample, truth_message

ORIGIN = (47.397742, 8.545594, 488.0)


class Watched(deque[TruthSample]):
    """Records at each iteration whether another thread could acquire the lock."""

    truth: NewestTruth
    open: list[bool]

    def _note(self) -> None:
        def reach() -> None:
            self.open.append(self.truth._lock.acquire(blocking=False))

        other = threading.Thread(target=reach)
        other.start()
        other.join()

    def __iter__(self) -> Iterator[TruthSample]:
        self._note()
        return super().__iter__()

    def __reversed__(self) -> Iterator[TruthSample]:
        self._note()
        return super().__reversed__()


@pytest.mark.parametrize("ask", ["together", "at", "before"])
def test_queries_hold_the_lock_while_they_iterate_over_the_samples(ask: str) -> None:
    truth = NewestTruth(ORIGIN)
    for drone in (0, 1):
        packer = Packer(drone + 1, 51)
        for k in range(5):
            place = (0.1 * k, 0.0, -2.0)
            message = truth_message(20_000 * k, place, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3, ORIGIN)
            truth.feed(packer.pack(message))
    newest = truth.of(0)
    assert newest is not None
    opened: list[bool] = []
    for drone, samples in truth._samples.items():
        truth._samples[drone] = watched = Watched(samples)
        watched.truth, watched.open = truth, opened
    queries = {
        "together": lambda: truth.together(0),
        "at": lambda: truth.at(0, 40_000),
        "before": lambda: truth.before(newest),
    }
    assert queries[ask]() is not None
    assert opened
    assert not any(opened)
