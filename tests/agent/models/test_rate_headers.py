"""Rate-limit headers are parsed, in the vendors' documented forms and with arbitrary values."""

from datetime import UTC, datetime, timedelta
from email.utils import format_datetime

from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.models.rate_limits import LONGEST_S, Allowance, allowances, until

NOW = datetime(2026, 3, 1, 12, 0, 0, tzinfo=UTC)


def test_openai_headers_give_request_and_token_allowances():
    headers = {
        "x-ratelimit-limit-requests": "60", "x-ratelimit-remaining-requests": "59", "x-ratelimit-reset-requests": "1s",
        "x-ratelimit-limit-tokens": "150000", "x-ratelimit-remaining-tokens": "149984",
        "x-ratelimit-reset-tokens": "6m0s",
    }  # fmt: skip
    assert allowances(headers, NOW) == (
        Allowance("requests", 60.0, 59.0, 1.0, steady=True),
        Allowance("tokens", 150_000.0, 149_984.0, 360.0, steady=True),
    )


def test_anthropic_reset_times_are_relative_to_the_date_header():
    headers = {
        "date": format_datetime(NOW - timedelta(hours=1), usegmt=True),  # the server's clock or ours is wrong
        "anthropic-ratelimit-requests-limit": "50", "anthropic-ratelimit-requests-remaining": "49",
        "anthropic-ratelimit-requests-reset": "2026-03-01T11:00:02Z",
        "anthropic-ratelimit-input-tokens-limit": "9", "anthropic-ratelimit-input-tokens-remaining": "1",
        "anthropic-ratelimit-input-tokens-reset": "2026-03-01T11:00:02Z",
        "anthropic-ratelimit-tokens-limit": "30000", "anthropic-ratelimit-tokens-remaining": "20000",
        "anthropic-ratelimit-tokens-reset": "2026-03-01T11:00:20Z",
    }  # fmt: skip
    assert allowances(headers, NOW) == (
        Allowance("requests", 50.0, 49.0, 2.0, steady=True),
        Allowance("tokens", 30_000.0, 20_000.0, 20.0, steady=True),  # the vendor's most restrictive limit
    )


def test_openrouter_headers_give_a_window_with_an_end_time():
    ends = str(int((NOW + timedelta(seconds=42)).timestamp() * 1000))
    headers = {"x-ratelimit-limit": "20", "x-ratelimit-remaining": "0", "x-ratelimit-reset": ends}
    assert allowances(headers, NOW) == (Allowance("requests", 20.0, 0.0, 42.0, steady=False),)


def test_reset_times_are_parsed_to_seconds():
    for text, seconds in [
        ("1s", 1.0), ("6m0s", 360.0), ("20ms", 0.02), ("1h2m3.5s", 3723.5), ("0s", 0.0), ("17", 17.0),
        ("2026-03-01T12:00:09+00:00", 9.0), ("2026-03-01T14:00:09+02:00", 9.0), ("2026-03-01T11:00:00Z", 0.0),
        ("99d", LONGEST_S), ("", None), ("soon", None), ("s", None), ("-3s", None), ("nan", None), (None, None),
    ]:  # fmt: skip
        assert until(text, NOW) == seconds, text


NAMES = [
    *(f"x-ratelimit-{word}{kind}" for word in ("limit", "remaining", "reset") for kind in ("", "-requests", "-tokens")),
    *(f"anthropic-ratelimit-tokens-{word}" for word in ("limit", "remaining", "reset")),
    "date",
]
WORDS = st.one_of(st.text(max_size=12), st.from_regex(r"\d{1,14}", fullmatch=True), st.sampled_from(["1s", "inf"]))


@given(st.dictionaries(st.sampled_from(NAMES), WORDS))
def test_arbitrary_headers_give_valid_allowances_or_none(headers):
    for allowance in allowances(headers, NOW):
        assert 0.0 <= allowance.left <= allowance.limit
        assert allowance.limit > 0.0
        assert 0.0 <= allowance.reset_s <= LONGEST_S
