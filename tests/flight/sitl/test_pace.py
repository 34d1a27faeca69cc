"""The rate keeper on a simulated clock: its waits and its counters."""

import pytest

from dronecats.flight.sitl import pace


class Clock:
    """Stands in for the time module: sleeping passes the time, and a little more."""

    def __init__(self, oversleep_s: float = 0.0) -> None:
        self.now_s, self.oversleep_s = 100.0, oversleep_s

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += max(seconds, 1e-5) + (self.oversleep_s if seconds else 0.0)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock(oversleep_s=0.0001)
    monkeypatch.setattr(pace, "time", clock)
    return clock


def test_ticks_keep_their_grid_although_sleep_is_inexact(clock: Clock) -> None:
    keeper = pace.RateKeeper(0.004)
    for tick in range(1, 1001):
        clock.now_s += 0.001  # work
        keeper.wait()
        assert 0.0 <= clock.now_s - (100.0 + 0.004 * tick) < 0.0001
    assert (keeper.ticks, keeper.late, keeper.late_share, keeper.skipped_s) == (1000, 0, 0.0, 0.0)


def test_a_long_tick_is_counted_and_caught_up(clock: Clock) -> None:
    keeper = pace.RateKeeper(0.004)
    clock.now_s += 0.011
    keeper.wait()
    assert keeper.lag_s == pytest.approx(0.007)
    keeper.wait()
    keeper.wait()
    assert (keeper.ticks, keeper.late) == (3, 2)
    assert clock.now_s == pytest.approx(100.012, abs=1e-4)
    assert keeper.lag_max_s == pytest.approx(0.007)


def test_a_long_standstill_is_skipped_and_not_caught_up(clock: Clock) -> None:
    keeper = pace.RateKeeper(0.010)
    clock.now_s += 3.0
    keeper.wait()
    assert keeper.skipped_s == pytest.approx(2.99)
    resumed_s = clock.now_s
    for _ in range(10):
        keeper.wait()
    assert clock.now_s == pytest.approx(resumed_s + 0.1, abs=1e-3)
    assert keeper.late == 1


def test_a_minute_with_late_ticks_is_reported_once(clock: Clock) -> None:
    keeper = pace.RateKeeper(0.1)
    report = pace.PaceReport(keeper)
    lines = []
    for tick in range(1900):  # three minutes and a little
        if 700 < tick < 800:
            clock.now_s += 0.104
        keeper.wait()
        lines += [line] if (line := report.line()) else []
    assert len(lines) == 1
    assert "17.0" in lines[0]
    assert keeper.figures()["late"] == 102  # 99 long ticks and those that caught up
