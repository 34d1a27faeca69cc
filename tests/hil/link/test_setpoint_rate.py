"""Setpoint rate: a rate below the tick rate, and a higher rate through faster telemetry."""

import itertools

from hypothesis import example, given
from hypothesis import strategies as st

from hil.link.offboard import SetpointRate
from hil.link.streams import FAST, Streams


@given(st.floats(2.0, 20.0), st.lists(st.integers(-1, 1), min_size=400, max_size=400))
@example(15.0, [0] * 400)
@example(19.92578125, ([0] * 6 + [-1, 1]) * 50)
@example(19.92578125, [-1, 1] * 200)
def test_setpoints_are_sent_at_the_requested_rate_and_evenly_spaced(hz: float, rounding: list[int]) -> None:
    rate = SetpointRate(hz)
    ticks = [50_000 * (n + 20) + 1000 * off for n, off in enumerate(rounding)]
    sent = [tick for tick in ticks if rate.due(tick)]
    assert abs(len(sent) - 20.0 * hz) <= 2  # in 20 s; a timestamp that is rounded up may cost one tick
    assert all(later - earlier > 1e6 / hz - 52_000 for earlier, later in itertools.pairwise(sent))


def test_without_a_rate_every_tick_is_due_and_a_clock_restart_causes_no_delay() -> None:
    always, seldom = SetpointRate(), SetpointRate(2.0)
    assert all(always.due(time_us) for time_us in (0, 50_000, 100_000, 10_000))
    assert seldom.due(90_000_000)
    assert not seldom.due(90_400_000)
    assert seldom.due(1_000_000)  # the vehicle has rebooted
    assert not seldom.due(1_400_000)
    assert seldom.due(60_000_000)  # after a pause, one setpoint is due, not all the missed ones
    assert not seldom.due(60_050_000)


def test_quicken_requests_faster_telemetry_and_restarts_the_count() -> None:
    streams = Streams()
    streams.check(1_000_000)
    requests = streams.quicken(20_000)
    assert [(request.message_id, request.interval_us) for request in requests] == [(i, 20_000) for i in FAST]
    assert streams.check(5_000_000) == []
    assert {streams.wanted[i] for i in FAST} == {20_000}
