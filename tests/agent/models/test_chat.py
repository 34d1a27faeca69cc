"""The model client against faulty endpoints, over real HTTP."""

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import PROVIDERS, ModelSpec, spec_of
from dronecats.agent.models.wire_formats import ChatModel, open_model
from foundation.errors import ModelError, UsageError
from tests.support.refusal import refusal

KEY = "sk-SECRET-1234567890"
REQUEST = Request("text", (b"\xff\xd8jpeg",), thinking=False)


@pytest.fixture
def endpoint():
    """An HTTP server that gives the responses in `answers`: (status, body, headers)."""
    answers: list[tuple[int, bytes, dict[str, str]]] = []
    seen: list[tuple[Any, dict[str, Any]]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            seen.append((self.headers, json.loads(body)))
            status, data, headers = answers.pop(0) if len(answers) > 1 else answers[0]
            self.send_response(status)
            for name, value in {"Content-Length": str(len(data)), **headers}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format, *args):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/v1", answers, seen
    server.shutdown()
    server.server_close()


def completion(content="{}", **more):
    return json.dumps({"choices": [{"message": {"content": content}}], **more}).encode()


def model(url, provider="openai"):
    return open_model(ModelSpec(provider=provider, name="m", base_url=url))


def test_request_is_one_user_message_with_text_before_the_image(endpoint, monkeypatch):
    url, answers, seen = endpoint
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    answers.append((200, completion('{"action":"think"}', usage={"prompt_tokens": 7, "completion_tokens": 3}), {}))
    reply = model(url).ask(REQUEST)
    assert (reply.text, reply.tokens_in, reply.tokens_out) == ('{"action":"think"}', 7, 3)
    headers, body = seen[0]
    assert headers["Authorization"] == f"Bearer {KEY}"
    (message,) = body["messages"]
    assert message["role"] == "user"
    assert [part["type"] for part in message["content"]] == ["text", "image_url"]
    assert message["content"][1]["image_url"]["url"].startswith("data:image/jpeg;base64,")
    assert "tools" not in body
    assert "functions" not in body
    assert body["temperature"] == 0.4


def test_thinking_changes_only_the_reasoning_options_of_the_request():
    for provider in [p.name for p in PROVIDERS.values() if p.wire == "openai" and p.thinking]:
        chat = model("http://127.0.0.1:1/v1", provider)
        quick = chat.body(REQUEST)
        slow = chat.body(Request("text", REQUEST.images_jpeg, thinking=True))
        assert quick != slow, provider
        changed = {key for key in quick.keys() | slow.keys() if quick.get(key) != slow.get(key)}
        assert changed <= {"reasoning_effort", "reasoning", "chat_template_kwargs"}, provider


def test_invalid_completions_are_model_errors(endpoint):
    url, answers, _ = endpoint
    for body in [
        b"",
        b"not json",
        b"[]",
        b"{}",
        b'{"choices":[]}',
        completion(None, usage=[1, 2]),
        b'{"choices":[{"message":{"content":5}}]}',
        b"[" * 100_000,
    ]:
        answers[:] = [(200, body, {})]
        assert "chat completion" in refusal(model(url, "local").ask, REQUEST, error=ModelError), body[:40]


@pytest.mark.parametrize("count", ["many", True, 1.5, -1_000_000, 10**30])
def test_invalid_token_counts_are_ignored(endpoint, count):
    url, answers, _ = endpoint
    answers.append((200, completion("x", usage={"prompt_tokens": count, "completion_tokens": count}), {}))
    reply = model(url, "local").ask(REQUEST)
    assert (reply.tokens_in, reply.tokens_out) == (None, None)


def test_a_busy_endpoint_is_retried_and_the_wait_does_not_count_as_latency(endpoint):
    url, answers, seen = endpoint
    answers += [(429, b"slow down", {"Retry-After": "0.3"}), (200, completion("ok"), {})]
    reply = model(url, "local").ask(REQUEST)
    assert reply.text == "ok"
    assert len(seen) == 2
    assert reply.waited_s >= 0.3
    assert reply.latency_s < reply.waited_s


def test_an_echoed_key_and_a_password_in_a_url_are_redacted(endpoint, monkeypatch):
    url, answers, _ = endpoint
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    answers.append((401, f"wrong key {KEY}, sir".encode(), {}))
    with pytest.raises(ModelError, match=r"401.*\*\*\*"):
        model(url).ask(REQUEST)
    with pytest.raises(UsageError) as refused:
        model("http://me:pw777@127.0.0.1:1/v1").check()
    assert "pw777" not in str(refused.value)


def test_declared_sampling_is_sent_and_a_temperature_of_none_is_omitted():
    declared = ModelSpec(provider="local", name="m", base_url="http://127.0.0.1:1", top_p=0.9, top_k=20)
    body = ChatModel(declared).body(REQUEST)
    assert (body["temperature"], body["top_p"], body["top_k"]) == (0.4, 0.9, 20)
    bare = ChatModel(ModelSpec(provider="local", name="m", base_url="http://127.0.0.1:1", temperature=None))
    assert bare.body(REQUEST).keys() == {"model", "messages", "max_tokens"}


def test_a_schema_is_sent_only_with_questions_that_it_describes():
    for provider in ["openai", "gemini", "anthropic"]:
        for question, has_schema in [
            (REQUEST, True),
            (Request("text", REQUEST.images_jpeg * 2, False), False),  # one object cannot answer for two drones
            (
                Request("text", REQUEST.images_jpeg * 2, False, role="commander"),
                True,
            ),  # the commander's own schema is an object
        ]:
            spec = ModelSpec(provider=provider, name="m", base_url="http://127.0.0.1:1", schema="object")
            body = str(open_model(spec).body(question))
            assert ("additionalProperties" in body) == has_schema, (provider, question)


def test_local_servers_use_the_loopback_and_need_no_key(monkeypatch):
    for provider in PROVIDERS.values():
        monkeypatch.delenv(provider.key_variable or "NONE", raising=False)
    own = [p for p in PROVIDERS.values() if (p.base_url or "").startswith("http://127.0.0.1:")]
    assert {p.name for p in own} == {"vllm", "sglang", "ollama", "llamacpp", "lmstudio", "litellm"}
    assert len({p.base_url for p in own}) == len(own)
    for provider in own:
        open_model(ModelSpec(provider=provider.name, name="m")).close()


def test_providers_are_split_at_the_first_slash():
    spec = spec_of("openrouter/qwen/qwen3.5-9b")
    assert (spec.provider, spec.name, spec.title) == ("openrouter", "qwen/qwen3.5-9b", "openrouter/qwen/qwen3.5-9b")
    with pytest.raises(UsageError, match="'openrouter'"):
        spec_of("openruter/x")
    with pytest.raises(UsageError, match="PROVIDER/NAME"):
        spec_of("openrouter")
