"""Rate limits of an address: clients stay within the allowance, each gets a turn, and a rejection holds all."""

import itertools
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.models.rate_limits import LONGEST_WAIT_S, SLOW_INTERVAL_S, SLOW_S, Allowance, RateLimitState

NOW = 1_000_000.0


def allowed(limit=10.0, left=10.0, reset_s=60.0, steady=True, kind="requests", model="m"):
    return RateLimitState().updated(model, Allowance(kind, limit, left, reset_s, steady), NOW)


def asked_until(turns, seconds, tokens=0, model="m"):
    """Claim a turn whenever one is allowed, for `seconds`; return the times of the granted claims."""
    now, moments = NOW, []
    while now < NOW + seconds:
        wait_s, turns = turns.claim(model, tokens, now)
        if wait_s == 0.0:
            moments.append(now)
        now += wait_s or 0.001
    return moments


def test_without_an_allowance_there_is_no_wait():
    assert RateLimitState().claim("m", 10**9, NOW)[0] == 0.0


def test_requests_are_spaced_as_a_steady_allowance_refills():
    moments = asked_until(allowed(limit=10.0, left=0.0), 60.0)
    assert len(moments) == 9  # one every six seconds, the first after six
    assert min(b - a for a, b in itertools.pairwise(moments)) == pytest.approx(6.0, abs=0.01)


def test_clients_use_up_a_window_and_wait_for_the_next():
    moments = asked_until(allowed(limit=3.0, left=2.0, reset_s=20.0, steady=False), 21.0)
    assert [round(moment - NOW) for moment in moments][:5] == [0, 0, 20, 20, 20]


def test_tokens_are_limited_and_an_oversized_question_waits_for_a_full_allowance():
    turns = allowed(limit=6000.0, left=6000.0, kind="tokens")
    assert len(asked_until(turns, 30.0, tokens=3000)) == 2
    assert len(asked_until(turns, 30.0, tokens=99_999)) == 1
    assert len(asked_until(turns, 61.0, tokens=99_999)) == 2


def test_allowances_are_per_model_but_a_hold_applies_to_all_models():
    turns = allowed(limit=10.0, left=0.0)
    assert turns.claim("other", 0, NOW)[0] == 0.0
    assert turns.held(7.0, NOW).claim("other", 0, NOW)[0] == pytest.approx(7.0)


def test_after_a_hold_requests_are_spaced_for_a_while():
    turns = RateLimitState().held(5.0, NOW)
    moments = asked_until(turns, 10.0)
    assert moments[0] == pytest.approx(NOW + 5.0)
    assert min(b - a for a, b in itertools.pairwise(moments)) >= SLOW_INTERVAL_S - 1e-6
    later = NOW + 5.0 + SLOW_S
    _, turns = turns.claim("m", 0, later)
    assert turns.claim("m", 0, later)[0] == 0.0


def test_the_longer_hold_applies_unless_the_clock_was_set_back():
    turns = RateLimitState().held(30.0, NOW).held(5.0, NOW)
    assert turns.claim("m", 0, NOW)[0] == pytest.approx(30.0)
    assert turns.claim("m", 0, NOW - 86_400.0)[0] == 0.0
    assert RateLimitState().held(1e9, NOW).claim("m", 0, NOW)[0] == LONGEST_WAIT_S


def test_an_answers_count_does_not_restore_claims_made_since():
    turns = allowed(limit=10.0, left=3.0, reset_s=60.0)
    for _ in range(3):
        _, turns = turns.claim("m", 0, NOW)
    turns = turns.updated(
        "m", Allowance("requests", 10.0, 2.0, 60.0, True), NOW
    )  # the answer to the first of the three
    assert turns.claim("m", 0, NOW)[0] > 0.0


ALLOWED = st.builds(
    Allowance,
    kind=st.sampled_from(["requests", "tokens"]),
    limit=st.floats(0.5, 1e6),
    left=st.just(0.0),
    reset_s=st.floats(0.0, 86_400.0),
    steady=st.booleans(),
)


@given(ALLOWED, st.floats(0.0, 1.0), st.integers(0, 10**7), st.floats(0.0, 100.0))
def test_any_allowance_eventually_grants_a_turn_and_never_exceeds_the_limit(allowance, part, tokens, held_s):
    turns = RateLimitState().updated("m", replace(allowance, left=allowance.limit * part), NOW).held(held_s, NOW)
    now = NOW
    for _ in range(20):
        wait_s, turns = turns.claim("m", tokens, now)
        if wait_s == 0.0:
            break
        now += wait_s
    else:
        pytest.fail("it waits for ever")
    assert all(0.0 <= bucket.left(now) <= bucket.full for bucket in turns.buckets.values())
