"""Gemini's format: requests and parsed responses, over real HTTP."""

import json

import pytest

from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from foundation.errors import ModelError, UsageError
from tests.agent.models.recording import Recording
from tests.support.refusal import refusal

KEY = "AIza-SECRET-1234567890"
REQUEST = Request("text", (b"\xff\xd8jpeg",), thinking=False)


def answer(*parts, usage=None, **candidate):
    content = {"content": {"role": "model", "parts": list(parts)}} if parts else {}
    return {"candidates": [{**content, "finishReason": "STOP", **candidate}], "usageMetadata": usage or {}}


def ask(response, request=REQUEST, status=200, name="gemini-x", **declared):
    """Return (the reply, the recorded request) for a server that answers `response`."""
    data = response if isinstance(response, bytes) else json.dumps(response).encode()
    with Recording(data, status) as server:
        model = open_model(ModelSpec(provider="gemini", name=name, base_url=server.url + "/v1", **declared))
        try:
            return model.ask(request), server.sent[0]
        finally:
            model.close()


def test_request_is_one_user_message_with_text_first_and_the_papers_sampling(monkeypatch):
    monkeypatch.setenv("GEMINI_API_KEY", KEY)
    _, sent = ask(answer({"text": "{}"}), Request("text", (b"a", b"b"), thinking=False))
    assert sent.path == "/v1/models/gemini-x:generateContent"
    assert sent.headers["x-goog-api-key"] == KEY
    assert "authorization" not in sent.headers
    (message,) = sent.body["contents"]
    assert [next(iter(part)) for part in message["parts"]] == ["text", "inlineData", "inlineData"]
    assert sent.body.keys() == {"contents", "generationConfig"}  # no system message, no tools
    assert sent.body["generationConfig"] == {"temperature": 0.4, "topP": 0.95, "topK": 40, "maxOutputTokens": 8192}


def test_declared_options_override_the_providers_defaults(monkeypatch):
    level = {"thinkingConfig": {"thinkingLevel": "high"}}
    thinking_request = Request("text", (), thinking=True)
    _, sent = ask(
        answer({"text": ""}), thinking_request, top_p=0.5, top_k=7, temperature=None, thinking=level, quick={}
    )
    config = sent.body["generationConfig"]
    assert config == {"topP": 0.5, "topK": 7, "maxOutputTokens": 8192, **level}


def test_a_model_name_is_escaped_in_the_url():
    _, sent = ask(answer({"text": ""}), name="../x?key=y#z")
    assert sent.path == "/v1/models/..%2Fx%3Fkey%3Dy%23z:generateContent"


@pytest.mark.parametrize(
    ("response", "text", "tokens"),
    [
        (answer({"text": '{"act'}, {"text": 'ion"}'}), '{"action"}', (None, None)),
        (answer({"text": "I muse", "thought": True}, {"text": "yes"}), "yes", (None, None)),
        (
            answer({"text": "x"}, usage={"promptTokenCount": 9, "candidatesTokenCount": 3, "thoughtsTokenCount": 4}),
            "x",
            (9, 7),
        ),
        (answer(finishReason="MAX_TOKENS", usage={"promptTokenCount": 9, "thoughtsTokenCount": 4}), "", (9, 4)),
        (answer(finishReason="SAFETY"), "", (None, None)),
        (answer({"text": "x"}, usage={"promptTokenCount": "many", "candidatesTokenCount": True}), "x", (None, None)),
        ({"promptFeedback": {"blockReason": "PROHIBITED_CONTENT"}}, "", (None, None)),
    ],
    ids=["parts", "thoughts", "tokens", "cut off", "withheld", "no counts", "blocked"],
)
def test_text_and_tokens_are_parsed(response, text, tokens):
    reply, _ = ask(response)
    assert (reply.text, (reply.tokens_in, reply.tokens_out)) == (text, tokens)


def test_invalid_responses_are_model_errors():
    answers: list[object] = [
        b"",
        b"<html>busy</html>",
        b"[" * 100_000,
        [],
        {},
        {"candidates": []},
        {"candidates": {}},
        {"candidates": [{}]},
        {"candidates": [{"content": {"parts": {}}}]},
        {"candidates": [{"content": {"parts": [{"text": 5}]}}]},
        {"candidates": [{"content": {"parts": ["text"]}}]},
    ]
    for response in answers:
        assert "Gemini" in refusal(ask, response, error=ModelError)


def test_an_echoed_key_is_redacted(monkeypatch):
    monkeypatch.setenv("GEMINI_API_KEY", KEY)
    with pytest.raises(ModelError, match=r"400.*\*\*\*") as refused:
        ask({"error": {"message": f"key {KEY} not valid"}}, status=400)
    assert KEY not in str(refused.value)
    reply, _ = ask(answer({"text": f"it is {KEY}"}))
    assert reply.text == "it is ***"


def test_opening_a_model_without_a_key_is_an_error(monkeypatch):
    monkeypatch.delenv("GEMINI_API_KEY", raising=False)
    with pytest.raises(UsageError, match="GEMINI_API_KEY"):
        open_model(ModelSpec(provider="gemini", name="gemini-x"))
