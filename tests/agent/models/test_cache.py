"""The reply cache sends an equal question once, for any API key. The cache file never contains a key."""

import re
import sqlite3
from dataclasses import replace

import pytest

from dronecats.agent.models.model import Reply, Request
from dronecats.agent.models.replay import CachedModel, ReplyCache
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from foundation.errors import InfrastructureError, UsageError
from tests.agent.models.faulty_wire import Wire, answer, say

KEY = "sk-SECRET-1234567890"
REQUEST = Request("text", (b"jpeg",), thinking=False)
ODD = "half a pair \ud800 and all of \U0001f681"


def choice(text, finish="stop"):
    usage = {"prompt_tokens": 7, "completion_tokens": 3}
    return say(answer(200, {"choices": [{"message": {"content": text}, "finish_reason": finish}], "usage": usage}))


@pytest.fixture
def wire():
    opened = Wire(choice(f'{ODD} {KEY} {{"action": "think"}}', "length"), choice("second"))
    yield opened
    opened.close()


def cached(spec, path):
    served = open_model(spec)
    return CachedModel(served, served.fingerprint, ReplyCache(path))


def test_an_equal_question_is_sent_once_and_gets_the_complete_stored_reply(wire, tmp_path, monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    spec, path = ModelSpec(provider="openai", name="m", base_url=wire.url), tmp_path / "replies.sqlite"
    first = cached(spec, path).ask(REQUEST)
    assert (first.finish, first.tokens_in, first.tokens_out) == ("length", 7, 3)
    assert first.text == f'{ODD} *** {{"action": "think"}}'
    monkeypatch.setenv("OPENAI_API_KEY", "another-key-987")
    assert cached(spec, path).ask(replace(REQUEST, step=5, drone=1)) == replace(first, waited_s=0.0)
    assert wire.served == 1
    for file in tmp_path.iterdir():
        assert KEY.encode() not in file.read_bytes()


SPEC = ModelSpec(provider="local", name="m", base_url="http://h/v1")


QUESTIONS = [
    (SPEC, REQUEST),
    (replace(SPEC, name="n"), REQUEST),
    (replace(SPEC, base_url="http://h/v2"), REQUEST),
    (replace(SPEC, base_url="http://h/deployments/a-long-name-of-a-deployment-1/v1"), REQUEST),
    (replace(SPEC, base_url="http://h/deployments/a-long-name-of-a-deployment-2/v1"), REQUEST),
    (replace(SPEC, base_url="http://h/v1?version=2"), REQUEST),
    (replace(SPEC, temperature=0.5), REQUEST),
    (replace(SPEC, provider="anthropic"), REQUEST),
    (SPEC, replace(REQUEST, text="other")),
    (SPEC, replace(REQUEST, images_jpeg=(b"jpeh",))),
    (replace(SPEC, provider="openrouter"), replace(REQUEST, thinking=True)),
    (replace(SPEC, provider="openrouter"), REQUEST),
]


def test_different_requests_have_different_fingerprints():
    assert len({open_model(spec).fingerprint(request) for spec, request in QUESTIONS}) == len(QUESTIONS)


@pytest.mark.parametrize(
    "url", ["http://me:pw777@h/v1", f"http://h/v1?api_key={KEY}", f"http://h/v1?Access-Token={KEY}", "http://h/v1#top"]
)
def test_credentials_and_fragments_in_the_url_do_not_change_the_fingerprint(url):
    assert open_model(replace(SPEC, base_url=url)).fingerprint(REQUEST) == open_model(SPEC).fingerprint(REQUEST)


def test_concurrent_equal_questions_share_the_first_stored_reply(tmp_path):
    first_cache, second_cache = (ReplyCache(tmp_path / "replies.sqlite") for _ in range(2))
    assert first_cache.keep("q", "m", Reply("mine", 1.0)).text == "mine"
    assert second_cache.keep("q", "m", Reply("yours", 2.0)) == Reply("mine", 1.0)


def test_an_invalid_cache_and_an_invalid_stored_reply_are_errors(tmp_path):
    path = tmp_path / "replies.sqlite"
    path.write_bytes(b"\x00garbage" * 1000)
    with pytest.raises(UsageError, match=re.escape(str(path))):
        ReplyCache(path)
    assert path.read_bytes() == b"\x00garbage" * 1000
    path.unlink()
    ReplyCache(path).keep("q", "m", Reply("x", 1.0))
    db = sqlite3.connect(path)
    db.execute("UPDATE replies SET reply = '{\"words\": 1}'")
    db.commit()
    db.close()
    with pytest.raises(InfrastructureError, match="cache"):
        ReplyCache(path).reply("q")


@pytest.mark.parametrize(
    "stored", ["{", "3", '{"text": "x"}', '{"text": 3, "latency_s": 1}', '{"text": "x", "latency_s": "1"}']
)
def test_a_malformed_stored_reply_is_an_error(tmp_path, stored):
    cache = ReplyCache(tmp_path / "cache.sqlite")
    cache.keep("question", "model", Reply("x", 1.0))
    with sqlite3.connect(tmp_path / "cache.sqlite") as db:
        db.execute("UPDATE replies SET reply = ?", (stored,))
    with pytest.raises(InfrastructureError, match="reply"):
        cache.reply("question")
    cache.close()
