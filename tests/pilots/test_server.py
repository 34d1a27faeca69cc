"""Tests that the pilots' endpoint speaks the OpenAI chat format, rejects other requests, and keeps running."""

import base64
import contextlib
import json

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dronecats.pilots import scripted as blind
from dronecats.pilots.server import MAX_BODY_BYTES, PilotServer, read_request
from foundation.errors import UsageError

JPEG = b"\xff\xd8\xff\xe0 not a whole picture \xff\xd9"


def request(text="Command: go to the cyan SUV", images=1):
    url = "data:image/jpeg;base64," + base64.b64encode(JPEG).decode()
    parts = [{"type": "text", "text": text}] + [{"type": "image_url", "image_url": {"url": url}}] * images
    return {"model": "blind", "messages": [{"role": "user", "content": parts}], "temperature": 0.4}


@pytest.fixture(scope="module")
def server():
    def pilot(prompt, images):
        if "break" in prompt:
            raise ValueError("broken on request")
        return json.dumps({"prompt": prompt, "images": [len(i) for i in images]})

    with PilotServer(pilot, "echo", owned_by="tests") as running:
        yield running


@pytest.fixture(scope="module")
def client(server):
    with httpx.Client(base_url=server.base_url) as running:
        yield running


def test_the_pilot_gets_text_and_pictures_and_its_reply_is_a_chat_completion(client):
    answer = client.post("/chat/completions", json=request(images=4)).json()
    assert answer["object"] == "chat.completion"
    assert answer["choices"][0]["message"]["role"] == "assistant"
    content = json.loads(answer["choices"][0]["message"]["content"])
    assert content == {"prompt": "Command: go to the cyan SUV", "images": [len(JPEG)] * 4}
    usage = answer["usage"]
    assert usage["total_tokens"] == usage["prompt_tokens"] + usage["completion_tokens"] > 4


def test_equal_requests_get_equal_bytes_on_a_persistent_connection(client):
    first, second = (client.post("/chat/completions", json=request()) for _ in range(2))
    assert first.content == second.content
    assert first.headers == second.headers
    assert first.http_version == "HTTP/1.1"
    assert "close" not in first.headers.get("connection", "")


def test_the_model_list_names_the_pilot(client):
    assert client.get("/models").json()["data"] == [
        {"id": "echo", "object": "model", "created": 0, "owned_by": "tests"}
    ]


def test_invalid_requests_are_rejected_with_a_reason(client):
    for body in (
        b"",
        b"[]",
        b"{",
        b"\xff\xfe",
        b"[" * 100_000,
        b'{"model": 1, "messages": []}',
        b'{"model": "m", "messages": []}',
        b'{"model": "m", "messages": [3]}',
        b'{"model": "m", "messages": [{"role": "user", "content": 3}]}',
        b'{"model": "m", "messages": [{"role": "user", "content": [{"type": "audio"}]}]}',
        b'{"model": "m", "messages": [{"role": "user", "content": [{"type": "image_url", "image_url": {"url": '
        b'"http://127.0.0.1/a.jpg"}}]}]}',
        b'{"model": "m", "messages": [{"role": "user", "content": [{"type": "image_url", "image_url": {"url": '
        b'"data:image/jpeg;base64,@@@"}}]}]}',
        b'{"model": "m", "messages": [{"role": "user", "content": "x"}], "stream": true}',
    ):
        answer = client.post("/chat/completions", content=body)
        assert answer.status_code == 400, body
        assert answer.json()["error"]["type"] == "invalid_request_error", body
        assert answer.json()["error"]["message"], body


def test_a_pilot_that_breaks_is_a_server_error_and_the_next_request_is_served(client):
    broken = client.post("/chat/completions", json=request("break"))
    assert broken.status_code == 500
    assert broken.json()["error"]["type"] == "server_error"
    assert client.post("/chat/completions", json=request()).status_code == 200


def test_other_paths_are_not_found(client):
    assert client.get("/").status_code == 404
    assert client.post("/embeddings", json={}).status_code == 404


def test_a_body_over_the_limit_is_rejected_and_the_server_keeps_running(client):
    assert client.post("/chat/completions", content=b" " * (MAX_BODY_BYTES + 1)).status_code == 413
    assert client.post("/chat/completions", content=iter([b"x"])).status_code == 411  # chunked: no length
    assert client.get("/models").status_code == 200


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200))
def test_any_bytes_get_status_400(client, body):
    assert client.post("/chat/completions", content=body).status_code == 400


_json = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["model", "messages", "role", "content", "type", "text", "image_url"]), inner)
    ),
    max_leaves=12,
)


@given(_json)
def test_any_json_is_read_or_rejected_with_a_usage_error(value):
    with contextlib.suppress(UsageError):  # any other exception fails the test
        prompt, images = read_request(json.dumps(value).encode())
        assert isinstance(prompt, str)
        assert all(isinstance(image, bytes) for image in images)


def test_the_server_has_a_loopback_address_and_names_a_port_in_use(server):
    assert server.base_url.startswith("http://127.0.0.1:")
    with pytest.raises(UsageError, match=str(server.port)):
        PilotServer(blind.answer, "blind", port=server.port)


def test_close_frees_the_port():
    first = PilotServer(blind.answer, "blind").start()
    port = first.port
    assert httpx.get(first.base_url + "/models").status_code == 200
    first.close()
    first.close()
    with pytest.raises(httpx.ConnectError):
        httpx.get(f"http://127.0.0.1:{port}/v1/models")
