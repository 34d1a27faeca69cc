"""Faults of an endpoint: each is retried within the attempts, is final, or gives a reply with a finish reason."""

import json
import socket

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.models.endpoint import RetryPolicy, delay_in, fault_in
from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from foundation.errors import ModelError, ModelRejectedError
from tests.agent.models.faulty_wire import AGAIN, HTML, Wire, answer, completion, say, trickle

REQUEST = Request("text", (b"jpeg",), thinking=False)
QUICK = RetryPolicy(give_up_s=5.0, attempts=3, pause_s=0.0)


@pytest.fixture
def serve():
    opened = []

    def start(*script):
        opened.append(Wire(*script))
        return opened[-1]

    yield start
    for wire in opened:
        wire.close()


def ask(wire, provider="local", patience=QUICK):
    return open_model(ModelSpec(provider=provider, name="m", base_url=wire.url), patience).ask(REQUEST)


FINAL = {
    "401": (say(answer(401, b"who are you")), "401"),
    "400 in a 200": (say(answer(200, {"error": {"code": 400, "message": "no such model"}})), "400.*no such model"),
    "a word in a 200": (say(answer(200, {"error": "model not loaded"})), "400"),
    "redirect": (say(answer(308, b"", "Location: /elsewhere")), "308"),
    "HTML": (say(answer(200, HTML)), "<html>"),
    "nothing in it": (say(answer(200, b"")), "empty"),
}


@pytest.mark.parametrize("fault", AGAIN.values(), ids=AGAIN)
def test_temporary_faults_are_retried_within_the_attempts(serve, fault):
    wire = serve(fault, fault, say(completion("there")))
    assert (ask(wire).text, wire.served) == ("there", 3)
    wire = serve(fault)
    with pytest.raises(ModelError):
        ask(wire)
    assert wire.served == 3


@pytest.mark.parametrize(("fault", "pattern"), FINAL.values(), ids=FINAL)
def test_permanent_faults_are_reported_without_a_retry(serve, fault, pattern):
    wire = serve(fault)
    with pytest.raises(ModelError, match=pattern):
        ask(wire)
    assert wire.served == 1


REJECTED = {
    "key": answer(401, b"who are you"),
    "a key within a 200": answer(200, {"error": {"code": 401, "message": "no"}}),
    "credit": answer(402, b"pay first"),
    "country": answer(403, b"not from there"),
    "model": answer(404, b"no such model"),
    "OpenAI's quota": answer(429, {"error": {"code": "insufficient_quota", "type": "insufficient_quota"}}),
    "Anthropic's credit": answer(400, {"error": {"message": "Your credit balance is too low to access"}}),
    "Gemini's day": answer(429, {"error": {"details": [{"quotaId": "GenerateRequestsPerDayPerProjectPerModel"}]}}),
    "OpenRouter's day": answer(429, {"error": {"message": "Rate limit exceeded: free-models-per-day"}}),
}


@pytest.mark.parametrize("fault", REJECTED.values(), ids=REJECTED)
def test_faults_that_affect_every_question_are_rejections_without_a_retry(serve, fault):
    wire = serve(say(fault))
    with pytest.raises(ModelRejectedError, match="/v1/chat/completions"):
        ask(wire)
    assert wire.served == 1


@pytest.mark.parametrize(
    "fault", [answer(400, b"too long"), answer(429, b"slow down", "Retry-After: 0"), answer(500, b"")]
)
def test_faults_of_one_question_are_not_rejections(serve, fault):
    with pytest.raises(ModelError) as refused:
        ask(serve(say(fault)))
    assert not isinstance(refused.value, ModelRejectedError)


def test_a_port_where_no_server_listens_cannot_be_reached():
    with socket.socket() as deaf:
        deaf.bind(("127.0.0.1", 0))  # keeps the port, and refuses connections
        url = f"http://127.0.0.1:{deaf.getsockname()[1]}/v1"
        model = open_model(ModelSpec(provider="local", name="m", base_url=url), QUICK)
        with pytest.raises(ModelError, match="cannot be reached"):
            model.ask(REQUEST)


@pytest.mark.parametrize("error", [httpx.ConnectTimeout("timed out"), httpx.ProxyError("503")])
def test_a_server_without_a_connection_cannot_be_reached(serve, monkeypatch, error):
    def refuse(transport, request):
        raise error

    monkeypatch.setattr(httpx.HTTPTransport, "handle_request", refuse)
    with pytest.raises(ModelError, match="cannot be reached"):
        ask(serve(say(completion("there"))))


def test_a_trickling_response_times_out_without_a_retry(serve):
    wire = serve(trickle(b'HTTP/1.1 200 OK\r\nContent-Length: 900000\r\n\r\n{"choices"'))
    with pytest.raises(ModelError, match=r"0\.5 s"):
        ask(wire, patience=RetryPolicy(give_up_s=0.5, pause_s=0.0))
    assert wire.served == 1


CHAT = {
    "stop": ({"content": "x"}, "stop", ("x", None)),
    "length": ({"content": '{"acti'}, "length", ('{"acti', "length")),
    "filtered": ({"content": ""}, "content_filter", ("", "filtered")),
    "refused": ({"content": None, "refusal": "I will not."}, "stop", ("I will not.", "refusal")),
    "thought all of it away": ({"content": None}, "length", ("", "length")),
    "only reasoning": ({"reasoning": "hm"}, "length", ("", "length")),
    "a word of its own": ({"content": "x"}, "eos_twice", ("x", "eos_twice")),
}


@pytest.mark.parametrize(("message", "finish", "expected"), CHAT.values(), ids=CHAT)
def test_unusual_ends_of_a_reply_have_a_finish_reason(serve, message, finish, expected):
    wire = serve(say(answer(200, {"error": None, "choices": [{"message": message, "finish_reason": finish}]})))
    reply = ask(wire)
    assert ((reply.text, reply.finish), wire.served) == (expected, 1)


@pytest.mark.parametrize("status", [403, 200])
def test_moderated_question_gets_an_empty_reply(serve, status):
    metadata = {"reasons": ["violence"], "flagged_input": "…"}
    wire = serve(say(answer(status, {"error": {"code": 403, "message": "flagged", "metadata": metadata}})))
    reply = ask(wire)
    assert (reply.text, reply.finish, wire.served) == ("", "filtered", 1)
    assert (reply.tokens_in, reply.tokens_out) == (0, 0)  # it costs nothing


def gemini(finish, **content):
    return {"candidates": [{**content, "finishReason": finish}]}


def message(stop, *texts):
    content = [{"type": "text", "text": text} for text in texts]
    return {"type": "message", "role": "assistant", "content": content, "stop_reason": stop}


@pytest.mark.parametrize(
    ("provider", "data", "expected"),
    [
        ("gemini", gemini("STOP", content={"parts": [{"text": "x"}]}), ("x", None)),
        ("gemini", gemini("SAFETY"), ("", "filtered")),
        ("gemini", gemini("MAX_TOKENS", content={"parts": [{"text": '{"a'}]}), ('{"a', "length")),
        ("gemini", {"promptFeedback": {"blockReason": "OTHER"}}, ("", "filtered")),
        ("gemini", gemini("LANGUAGE"), ("", "LANGUAGE")),
        ("anthropic", message("end_turn", "x"), ("x", None)),
        ("anthropic", message("refusal"), ("", "refusal")),
        ("anthropic", message("max_tokens", '{"a'), ('{"a', "length")),
    ],
)
def test_gemini_and_anthropic_replies_have_a_finish_reason(serve, provider, data, expected):
    reply = ask(serve(say(answer(200, data))), provider)
    assert (reply.text, reply.finish) == expected


def test_retry_delay_is_read_from_geminis_error_body(serve):
    details = [{"@type": "type.googleapis.com/google.rpc.Help"}, {"retryDelay": "0.4s"}]
    busy = answer(429, {"error": {"code": 429, "status": "RESOURCE_EXHAUSTED", "details": details}})
    assert ask(serve(say(busy), say(completion("x")))).waited_s >= 0.4
    assert delay_in(busy.partition(b"\r\n\r\n")[2]) == 0.4
    for other in (
        b"",
        b"{",
        b"[]",
        b'{"error": 5}',
        b'{"error": {"details": [{"retryDelay": "soon"}]}}',
        b"[" * 99_999,
    ):
        assert delay_in(other) is None


def test_answers_without_an_error_have_no_fault():
    answers: list[object] = [{}, [], {"error": None}, {"error": {}}, {"choices": []}, {"choices": [{"error": None}]}]
    for data in answers:
        assert fault_in(json.dumps(data).encode()) is None
    assert fault_in(b"[" * 99_999) is None
    fault = fault_in(b'{"error": {"code": 200}}')
    assert fault is not None
    assert fault[0] == 400


WORDS = ["error", "choices", "code", "status", "type", "details", "retryDelay"]
TEXTS = st.one_of(st.text(max_size=9), st.sampled_from(["429", "5s"]))
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), TEXTS),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.sampled_from(WORDS), inner),
        st.builds(lambda value: {"error": value}, inner),
    ),
)


@given(st.one_of(JSON.map(lambda value: json.dumps(value).encode()), st.binary(max_size=30)))
def test_any_body_gives_no_fault_or_a_valid_error_status(body):
    fault, delay_s = fault_in(body), delay_in(body)
    assert fault is None or 400 <= fault[0] <= 599
    assert delay_s is None or 0.0 <= delay_s < 1e7
