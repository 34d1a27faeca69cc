"""A key is masked in every encoding, and other text stays readable."""

import base64
import html
import json
from urllib.parse import quote, quote_plus

from hypothesis import given, settings
from hypothesis import strategies as st

from foundation.redaction import hide_secrets, redacted, redacted_url, secrets_of

HEX = "0123456789abcdef0123456789abcdef01234567"


def test_possible_keys_are_masked_in_urls():
    for url, shown in [
        ("http://127.0.0.1:8000/v1", "http://127.0.0.1:8000/v1"),
        ("http://[::1]:80/v1/", "http://[::1]:80/v1/"),
        ("https://gw.host/openai/deployments/gpt-4o?api-version=2024-05-01", "https://gw.host/openai/deployments/gpt-4o?api-version=***"),
        (f"http://h:1/{HEX}/v1?api_key=s&b#{HEX}", "http://h:1/***/v1?api_key=***&***#***"),
        ("http://h/sk-abc123456/v1", "http://h/***/v1"),
        ("http://me:pw777@h/v1", "http://***@h/v1"),
        ("http://me:p@w@h/v1", "http://***@h/v1"),
        ("http://h/a%2Fb/v1", "http://h/***/v1"),
        ("h:8000/v1?key=abc", "h:8000/v1?key=***"),
        ("http://[nonsense", "http://***"),
        ("udpin://me:pw@0.0.0.0:14540", "udpin://***@0.0.0.0:14540"),
        ("serial:///dev/ttyUSB0?baud=57600", "serial:///dev/ttyUSB0?baud=57600"),
    ]:  # fmt: skip
        assert redacted_url(url) == shown, url
        if "://" in url:
            assert redacted(f"it says ({url}).") == f"it says ({shown}).", url


KEYS = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=6, max_size=40)
SPELT = [
    str,
    quote,
    lambda key: quote(key, safe=""),
    quote_plus,
    lambda key: quote(quote(key, safe=""), safe=""),
    lambda key: "".join(f"%{byte:02x}" for byte in key.encode()),
    lambda key: json.dumps(key)[1:-1],
    lambda key: json.dumps(json.dumps(key))[3:-3],
    lambda key: json.dumps(key, ensure_ascii=False)[1:-1].replace("/", "\\/"),
    html.escape,
]


@settings(deadline=None, max_examples=40)
@given(KEYS, st.sampled_from(SPELT), st.sampled_from(["", "ä ", "%2", "\\"]), st.sampled_from(["", " z", "%41", "&"]))
def test_a_key_is_masked_in_every_encoding(key, spell, before, after):
    assert spell(key) not in hide_secrets(before + spell(key) + after, key)
    assert hide_secrets(f"<{spell(key)}>", key) == "<***>"


@settings(deadline=None, max_examples=40)
@given(KEYS)
def test_masked_parts_of_a_url_count_as_secrets_in_other_text(key):
    key = HEX + key
    spelt = quote(key, safe="")
    for place in ("{}/v1", "v1?a=b&k={}", "v1?{}", "v1#{}"):
        url = "http://h/" + place.format(spelt)
        for echo in (url, spelt, key):
            text = redacted(f"no such page: {echo}", *secrets_of(url))
            assert key not in text
            assert spelt not in text


def test_the_basic_authentication_header_is_a_secret():
    header = "Basic " + base64.b64encode(b"pilot:hush-hush").decode()
    assert redacted(header, *secrets_of("http://pilot:hush-hush@h/v1")) == "Basic ***"


def test_action_words_and_short_strings_are_never_masked():
    url = "http://a:b@h/v1?mode=rotate&x=finished&n=500&d=depth_m&y=point"
    reply = '{"action":"rotate","point":[500,500],"depth_m":9} finished a b'
    assert hide_secrets(reply, *secrets_of(url)) == reply
