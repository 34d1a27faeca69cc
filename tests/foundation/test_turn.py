"""One thread computes; the others wait in the order of their requests. A thread can lend its turn to others."""

import threading

import pytest

from foundation.threads import STEPS, ComputingTurn


def start(*jobs):
    threads = [threading.Thread(target=job, daemon=True) for job in jobs]
    for thread in threads:
        thread.start()
    return threads


def ended(threads):
    for thread in threads:
        thread.join(10.0)
    return not any(thread.is_alive() for thread in threads)


def asking(turn, seen, count):
    """Wait until `count` threads are in the queue."""
    while len(turn._queue) < count:
        assert not seen.is_set()
        threading.Event().wait(0.001)


def test_one_thread_computes_at_a_time_in_order_of_requests():
    turn, order, inside, never = ComputingTurn(), [], [], threading.Event()

    def job(number):
        with turn.taken():
            inside.append(number)
            assert len(inside) == 1
            order.append(number)
            inside.remove(number)

    with turn.taken():
        threads = []
        for number in range(5):
            threads += start(lambda number=number: job(number))
            asking(turn, never, number + 1)
        assert order == []
    assert ended(threads)
    assert order == [0, 1, 2, 3, 4]


def test_a_thread_that_lends_its_turn_lets_others_compute_before_it_continues():
    turn, answered = ComputingTurn(), threading.Event()

    def answer():
        with turn.taken():
            answered.set()

    with turn.taken():
        threads = start(answer)
        with turn.lent():
            assert answered.wait(10.0)
        assert not turn._queue
        threads += start(answer)
        asking(turn, threading.Event(), 1)
    assert ended(threads)


def test_a_thread_without_the_turn_lends_nothing():
    turn = ComputingTurn()
    with turn.taken():
        threads = start(lambda: turn.lent().__enter__())
        assert ended(threads)
        late = start(lambda: turn.taken().__enter__())
        asking(turn, threading.Event(), 1)
    assert ended(late)


def test_an_exception_releases_the_turn():
    turn = ComputingTurn()
    with pytest.raises(ValueError, match="lent"), turn.taken(), turn.lent():
        raise ValueError("lent")
    with pytest.raises(ValueError, match="taken"), turn.taken():
        raise ValueError("taken")
    assert ended(start(lambda: turn.taken().__enter__()))


def test_a_thread_that_never_waits_yields_after_some_steps():
    turn, had = ComputingTurn(), threading.Event()

    def other():
        with turn.taken():
            had.set()

    with turn.taken():
        threads = start(other)
        asking(turn, had, 1)
        for _ in range(STEPS):
            turn.step()
        assert not had.is_set()
        turn.step()
        assert had.is_set()
        with turn.lent():  # lending the turn resets the step count
            pass
        threads += start(other)
        had.clear()
        asking(turn, had, 1)
        turn.step()
        assert not had.is_set()
    turn.step()  # no effect for a thread without the turn
    assert ended(threads)
