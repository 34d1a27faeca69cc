"""What several flights of a process share is made once, whoever asks at the same time."""

import threading
from concurrent.futures import ThreadPoolExecutor

from episodes import maps
from foundation.threads import once


def test_who_asks_for_one_in_the_making_waits_for_it():
    made, asked = [], threading.Barrier(4)
    going_on = threading.Event()

    @once(2)
    def thing(name):
        made.append(name)
        going_on.wait(0.2)  # long enough for the others to ask, were they let in
        return object()

    def ask(name):
        asked.wait()
        return thing(name)

    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(ask, ["a"] * 4))
    assert made == ["a"]
    assert len(set(found)) == 1
    assert thing("b") is not found[0]
    assert thing("a") is found[0]
    thing("b"), thing("c")  # the one used last but one is let go
    assert thing("a") is not found[0]
    assert made == ["a", "b", "c", "a"]


def test_a_map_is_built_once():
    with ThreadPoolExecutor(2) as threads:
        one, other = threads.map(lambda _: maps.build("blocks", 1), range(2))
    assert one is other
