"""Each reply has the name of the model that the vendor served. It is more precise than the requested name."""

import json
from typing import Any

import pytest

from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from tests.agent.models.recording import Recording

CHAT = {"choices": [{"message": {"content": "{}"}, "finish_reason": "stop"}]}
MESSAGE = {"type": "message", "content": [{"type": "text", "text": "{}"}], "stop_reason": "end_turn"}
CONTENT = {"candidates": [{"content": {"parts": [{"text": "{}"}]}, "finishReason": "STOP"}]}
KEY = "sk-SECRET-1234567890"


@pytest.mark.parametrize(
    ("provider", "response", "served"),
    [
        ("openai", {**CHAT, "model": "m-2026-01-01", "system_fingerprint": "fp_9"}, "m-2026-01-01 fp_9"),
        ("openai", {**CHAT, "model": "m-2026-01-01", "system_fingerprint": None}, "m-2026-01-01"),
        ("openai", {**CHAT, "model": "m"}, None),
        ("openai", {**CHAT, "model": "m", "system_fingerprint": "fp_9"}, "m fp_9"),
        ("openai", {**CHAT, "model": 7, "system_fingerprint": ["x"]}, None),
        ("openai", {**CHAT, "model": "m" * 1000}, "m" * 100),
        ("openai", {**CHAT, "model": "a\nb"}, None),
        ("openai", {**CHAT, "model": f"m {KEY}"}, "m •••"),
        ("openai", CHAT, None),
        ("anthropic", {**MESSAGE, "model": "m-20260101"}, "m-20260101"),
        ("gemini", {**CONTENT, "modelVersion": "m-002"}, "m-002"),
        ("gemini", CONTENT, None),
    ],
)
def test_the_reply_has_the_served_model_name_and_version(
    provider: str, response: dict[str, Any], served: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    with Recording(json.dumps(response).encode()) as server:
        model = open_model(ModelSpec(provider=provider, name="m", base_url=server.url + "/v1"))
        try:
            served_name = model.ask(Request("text", (), thinking=False)).served
        finally:
            model.close()
    if served and "•••" in served:
        assert served_name is not None
        assert KEY not in served_name
    else:
        assert served_name == served


USED: dict[str, Any] = {"prompt_tokens": 900, "completion_tokens": 70}
DETAILS: dict[str, Any] = {
    "prompt_tokens_details": {"cached_tokens": 512},
    "completion_tokens_details": {"reasoning_tokens": 64},
}


@pytest.mark.parametrize(
    ("provider", "response", "tokens", "endpoint"),
    [
        ("openrouter", {**CHAT, "usage": USED | DETAILS, "provider": "Novita"}, (900, 70, 512, 64), "Novita"),
        ("openai", {**CHAT, "usage": USED}, (900, 70, None, None), None),
        ("openai", {**CHAT, "usage": USED | {"prompt_tokens_details": 7}, "provider": 7}, (900, 70, None, None), None),
        ("anthropic", {**MESSAGE, "usage": {"input_tokens": 100, "cache_read_input_tokens": 800, "output_tokens": 7}},
         (900, 7, 800, None), None),
        ("gemini", {**CONTENT, "usageMetadata": {"promptTokenCount": 900, "cachedContentTokenCount": 512,
                                                 "candidatesTokenCount": 6, "thoughtsTokenCount": 64}},
         (900, 70, 512, 64), None),
    ],
)  # fmt: skip
def test_cached_and_reasoning_tokens_and_the_endpoint_of_a_router_are_kept(
    provider: str, response: dict[str, Any], tokens: tuple[int | None, ...], endpoint: str | None
) -> None:
    with Recording(json.dumps(response).encode()) as server:
        model = open_model(ModelSpec(provider=provider, name="m", base_url=server.url + "/v1"))
        try:
            reply = model.ask(Request("text", (), thinking=False))
        finally:
            model.close()
    assert (reply.tokens_in, reply.tokens_out, reply.tokens_cached, reply.tokens_reasoning) == tokens
    assert reply.endpoint == endpoint
