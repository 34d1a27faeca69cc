import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.flight.processes.supervisor import CHECK_MAX_S, HEARTBEAT_PERIOD_S, Heartbeat

PATIENCE_S = 30.0


@given(st.floats(0.01, CHECK_MAX_S))
def test_a_silent_process_counts_as_hanging_once_patience_is_over(tick_s):
    beat, now_s = Heartbeat(PATIENCE_S), 1000.0
    assert beat.is_due(now_s)
    beat.sent(now_s)
    while not beat.hangs(now_s):
        assert not beat.is_due(now_s)  # one request at a time
        now_s += tick_s
    assert now_s - 1000.0 == pytest.approx(PATIENCE_S, abs=2 * tick_s)


@given(st.lists(st.floats(0.0, PATIENCE_S - 2 * CHECK_MAX_S), min_size=1, max_size=20), st.floats(0.01, CHECK_MAX_S))
def test_a_slow_process_that_answers_never_counts_as_hanging(delays_s, tick_s):
    beat, now_s = Heartbeat(PATIENCE_S), 0.0
    for delay_s in delays_s:
        while not beat.is_due(now_s):
            assert not beat.hangs(now_s)
            now_s += tick_s
        beat.sent(now_s)
        answers_s = now_s + delay_s
        while now_s < answers_s:
            assert not beat.hangs(now_s)
            now_s += tick_s
        beat.answered(now_s)


@given(st.floats(0.0, 1e6))
def test_a_pause_of_the_supervisor_does_not_count_against_the_process(pause_s):
    beat = Heartbeat(PATIENCE_S)
    beat.sent(0.0)
    assert not beat.hangs(pause_s)
    assert not beat.hangs(pause_s + PATIENCE_S - 2 * CHECK_MAX_S)


def test_the_next_heartbeat_is_due_one_period_after_the_answer():
    beat = Heartbeat(PATIENCE_S)
    beat.sent(0.0)
    beat.answered(0.1)
    assert not beat.is_due(0.1 + 0.9 * HEARTBEAT_PERIOD_S)
    assert beat.is_due(0.1 + HEARTBEAT_PERIOD_S)
