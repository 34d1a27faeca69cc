"""The playback thread: it shows every order in sequence, and continues after an error."""

import threading
from functools import partial
from typing import Any

import pytest

from dronecats.view.replay.player import RATE_HZ, PlaybackClock, Player

PATIENCE_S = 60.0


@pytest.fixture
def shown():
    return []


@pytest.fixture
def player(shown):
    made = Player(PlaybackClock(10.0), lambda t_s, clock: shown.append(t_s))
    yield made
    made.close()


def test_a_paused_player_shows_only_the_orders(player, shown):
    assert player.idle(PATIENCE_S)
    assert shown == [0.0]
    player.order(lambda clock, wall_s: clock.scrubbed(4.0, wall_s))
    assert player.idle(PATIENCE_S)
    assert (shown, player.t_s) == ([0.0, 4.0], 4.0)
    player.again()
    assert player.idle(PATIENCE_S)
    assert shown == [0.0, 4.0, 4.0]


def test_the_player_stops_at_the_end(player, shown):
    player.order(lambda clock, wall_s: clock.at_speed(20.0, wall_s))
    player.order(PlaybackClock.toggled)
    assert player.idle(PATIENCE_S)  # half a second of wall time
    assert shown == sorted(shown)
    assert shown[-1] == 10.0 == player.t_s
    assert not player.clock.playing
    assert 2 < len(shown) <= 0.5 * RATE_HZ + 4


def scrubbed(t_s, clock, wall_s):
    return clock.scrubbed(t_s, wall_s)


def test_the_player_continues_after_an_exception(monkeypatch):
    exceptions: list[Any] = []
    shown: list[float] = []
    monkeypatch.setattr(threading, "excepthook", exceptions.append)

    def show(t_s, clock):
        if t_s == 3.0:
            raise ValueError("no")
        shown.append(t_s)

    player = Player(PlaybackClock(10.0), show)
    try:
        for t_s in (3.0, 5.0):
            player.order(partial(scrubbed, t_s))
            assert player.idle(PATIENCE_S)
    finally:
        player.close()
    assert shown[-1] == 5.0
    assert [str(exception.exc_value) for exception in exceptions] == ["no"]


def test_a_slow_page_skips_times_and_does_not_fall_behind(shown):
    held = threading.Event()

    def show(t_s, clock):
        shown.append(t_s)
        held.wait(0.2)  # a slow browser

    player = Player(PlaybackClock(10.0, speed=20.0), show)
    try:
        player.order(PlaybackClock.toggled)
        assert player.idle(PATIENCE_S)
    finally:
        held.set()
        player.close()
    assert shown[-1] == 10.0
    assert len(shown) <= 8
