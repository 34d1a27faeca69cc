"""Anthropic's format: requests and parsed responses, over real HTTP."""

import json

import pytest

from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import ANTHROPIC_SAMPLING_VERSION, ANTHROPIC_VERSION, open_model
from foundation.errors import ModelError, UsageError
from tests.agent.models.recording import Recording
from tests.support.refusal import refusal

KEY = "sk-ant-SECRET-1234567890"
REQUEST = Request("text", (b"\xff\xd8jpeg",), thinking=False)
LIFTED = Request("text", (b"\xff\xd8jpeg",), thinking=True)

BUDGET = {"thinking": {"type": "enabled", "budget_tokens": 4096}}  # the form for models up to Claude Opus 4.6


def answer(*blocks, usage=None, **more):
    return {"type": "message", "role": "assistant", "content": list(blocks), "usage": usage or {}, **more}


def text(content):
    return {"type": "text", "text": content}


def ask(response, request=REQUEST, status=200, **declared):
    """Return (the reply, the recorded request) for a server that answers `response`."""
    data = response if isinstance(response, bytes) else json.dumps(response).encode()
    with Recording(data, status) as server:
        model = open_model(ModelSpec(provider="anthropic", name="claude-x", base_url=server.url + "/v1", **declared))
        try:
            return model.ask(request), server.sent[0]
        finally:
            model.close()


def test_request_is_one_user_message_with_text_first_and_the_papers_sampling(monkeypatch):
    monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
    _, sent = ask(answer(text("{}")), Request("text", (b"a", b"b"), thinking=False))
    assert sent.path == "/v1/messages"
    assert sent.headers["x-api-key"] == KEY
    assert "authorization" not in sent.headers
    (message,) = sent.body["messages"]
    assert message["role"] == "user"
    assert [part["type"] for part in message["content"]] == ["text", "image", "image"]
    assert sent.body.keys() == {"model", "messages", "max_tokens", "temperature"}  # no system message, no tools
    assert (sent.body["temperature"], sent.body["max_tokens"]) == (0.4, 8192)


def test_sampling_options_are_omitted_with_reasoning():
    _, sent = ask(answer(), LIFTED, top_p=0.9, top_k=40, thinking=BUDGET)
    assert sent.body.keys() == {"model", "messages", "max_tokens", "thinking"}
    adaptive = {"thinking": {"type": "adaptive"}, "output_config": {"effort": "high"}}
    _, sent = ask(answer(), LIFTED, thinking=adaptive, schema="object")
    assert "temperature" not in sent.body
    assert sent.body["thinking"] == {"type": "adaptive"}
    assert sent.body["output_config"].keys() == {"effort", "format"}
    _, sent = ask(answer(), REQUEST, top_p=0.9, top_k=40, quick={"thinking": {"type": "disabled"}})
    assert (sent.body["temperature"], sent.body["top_p"], sent.body["top_k"]) == (0.4, 0.9, 40)


def test_api_version_depends_on_the_declared_temperature():
    assert ask(answer())[1].headers["anthropic-version"] == ANTHROPIC_SAMPLING_VERSION
    _, sent = ask(answer(), temperature=None)
    assert sent.headers["anthropic-version"] == ANTHROPIC_VERSION
    assert sent.body.keys() == {"model", "messages", "max_tokens"}


def test_unsupported_options_are_rejected_before_a_request():
    with pytest.raises(UsageError, match="array"):
        open_model(ModelSpec(provider="anthropic", name="m", base_url="http://127.0.0.1:1", schema="array"))
    with pytest.raises(UsageError, match="4096"):
        open_model(
            ModelSpec(provider="anthropic", name="m", base_url="http://127.0.0.1:1", max_tokens=4096, thinking=BUDGET)
        )


@pytest.mark.parametrize(
    ("response", "reply_text", "tokens"),
    [
        (answer(text('{"act'), text('ion"}')), '{"action"}', (None, None)),
        (answer({"type": "thinking", "thinking": "I muse", "signature": "s"}, text("yes")), "yes", (None, None)),
        (answer({"type": "redacted_thinking", "data": "abc"}, text("yes")), "yes", (None, None)),
        (answer(text("x"), usage={"input_tokens": 9, "output_tokens": 7}), "x", (9, 7)),
        (answer(text("x"), usage={"input_tokens": None, "output_tokens": True}), "x", (None, None)),
        (answer(stop_reason="refusal", usage={"input_tokens": 9, "output_tokens": 0}), "", (9, 0)),
        (answer({"type": "thinking", "thinking": "…"}, stop_reason="max_tokens"), "", (None, None)),
    ],
    ids=["blocks", "thoughts", "hidden thoughts", "tokens", "no counts", "refusal", "cut off"],
)
def test_text_and_tokens_are_parsed(response, reply_text, tokens):
    reply, _ = ask(response)
    assert (reply.text, (reply.tokens_in, reply.tokens_out)) == (reply_text, tokens)


def test_invalid_responses_are_model_errors():
    answers: list[object] = [
        b"",
        b"<html>busy</html>",
        b"[" * 100_000,
        [],
        {},
        {"type": "error", "content": []},
        {"type": "message"},
        {"type": "message", "content": {}},
        {"type": "message", "content": [{"type": "text", "text": 5}]},
        {"type": "message", "content": ["text"]},
    ]
    for response in answers:
        assert "Anthropic" in refusal(ask, response, error=ModelError)


def test_an_echoed_key_is_redacted(monkeypatch):
    monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
    with pytest.raises(ModelError, match=r"401.*\*\*\*") as refused:
        ask({"type": "error", "error": {"message": f"invalid x-api-key {KEY}"}}, status=401)
    assert KEY not in str(refused.value)
    reply, _ = ask(answer(text(f"it is {KEY}")))
    assert reply.text == "it is ***"


@pytest.mark.parametrize(
    ("field", "value", "key"),
    [
        ("thinking", {"thinking": "on"}, "thinking"),
        ("quick", {"thinking": 3}, "thinking"),
        ("quick", {"output_config": 5}, "output_config"),
        ("thinking", {"thinking": {"type": "enabled", "budget_tokens": "x"}}, "budget_tokens"),
    ],
)
def test_invalid_reasoning_options_are_rejected_when_the_model_is_opened(field, value, key):
    declared = ModelSpec(provider="anthropic", name="x", base_url="http://127.0.0.1:9/v1", **{field: value})
    with pytest.raises(UsageError, match=key):
        open_model(declared)


def test_opening_a_model_without_a_key_is_an_error(monkeypatch):
    monkeypatch.delenv("ANTHROPIC_API_KEY", raising=False)
    with pytest.raises(UsageError, match="ANTHROPIC_API_KEY"):
        open_model(ModelSpec(provider="anthropic", name="claude-x"))
