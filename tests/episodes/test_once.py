"""Resources shared by several flights of a process are created once, even for simultaneous requests."""

import threading
from concurrent.futures import ThreadPoolExecutor

from episodes import maps
from foundation.threads import once


def test_requests_during_creation_wait_for_the_value():
    made, all_asked = [], threading.Barrier(4)
    going_on = threading.Event()

    @once(2)
    def thing(name):
        made.append(name)
        going_on.wait(0.2)  # gives the other threads time to enter, if `once` lets them
        return object()

    def ask(name):
        all_asked.wait()
        return thing(name)

    with ThreadPoolExecutor(4) as threads:
        values = list(threads.map(ask, ["a"] * 4))
    assert made == ["a"]
    assert len(set(values)) == 1
    assert thing("b") is not values[0]
    assert thing("a") is values[0]
    thing("b"), thing("c")  # the least recently used value is dropped
    assert thing("a") is not values[0]
    assert made == ["a", "b", "c", "a"]


def test_a_map_is_built_once():
    with ThreadPoolExecutor(2) as threads:
        one, other = threads.map(lambda _: maps.build("blocks", 1), range(2))
    assert one is other
