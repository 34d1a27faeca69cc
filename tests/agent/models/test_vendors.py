"""Our client and the vendor's client send equal requests for the same question, field by field.

Importing the clients takes ten seconds, so these tests are slow, and each imports its own client.
"""

import base64
import re
import typing
from dataclasses import asdict, replace
from itertools import product
from typing import Any

import pytest

from dronecats.agent.models.model import Request
from dronecats.agent.models.reply_schema import action_schema, flat_action_schema, orders_schema, response_format
from dronecats.agent.models.rows import rows
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from tests.agent.models.recording import Recording, Sent

pytestmark = pytest.mark.slow

KEY = "sk-SECRET-1234567890"
TEXT = "a prompt, with “quotes” and\nlines"
JPEG = b"\xff\xd8\xff\xfb\xef\xbe"  # its base64 has both characters in which the two alphabets differ
PICTURES = (1, 4)
LABELS = tuple(f"Drone {n}:" for n in range(1, 5))  # labels of a fleet's images; a single image has none
LIFTED = (False, True)


def request(pictures: int, thinking: bool) -> Request:
    jpegs = tuple(JPEG + bytes([n]) for n in range(pictures))
    return Request(TEXT, jpegs, thinking, LABELS if pictures > 1 else ())


def between(labels: list[Any], images: list[Any]) -> list[Any]:
    """Return a fleet's parts in order, each label before its image. A single image has no label."""
    if len(images) == 1:
        return images
    return [part for pair in zip(labels, images, strict=True) for part in pair]


def ours(monkeypatch: pytest.MonkeyPatch, question: Request, base: str, answer: bytes, **declared: Any) -> Sent:
    """Return our client's request to a server. The vendor's API is at `base` below the server's address."""
    for name in ("OPENAI", "OPENROUTER", "OLLAMA", "VLLM", "GEMINI", "ANTHROPIC"):
        monkeypatch.setenv(f"{name}_API_KEY", KEY)
    with Recording(answer) as server:
        model = open_model(ModelSpec(base_url=server.url + base, **declared))
        model.ask(question)
        model.close()
    (sent,) = server.sent
    assert KEY not in sent.path
    return sent


def texts() -> list[Any]:
    return [{"type": "text", "text": label} for label in LABELS]


CHAT = b'{"id":"1","object":"chat.completion","created":1,"model":"m","choices":[{"index":0,"finish_reason":"stop","message":{"role":"assistant","content":"{}"}}]}'  # noqa: E501
SWITCHES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "openai": ({"reasoning_effort": "minimal"}, {"reasoning_effort": "medium"}),
    "openrouter": ({"extra_body": {"reasoning": {"enabled": False}}}, {"extra_body": {"reasoning": {"enabled": True}}}),
    "ollama": ({"reasoning_effort": "none"}, {"reasoning_effort": "medium"}),
    "vllm": (
        {"extra_body": {"chat_template_kwargs": {"enable_thinking": False}}},
        {"extra_body": {"chat_template_kwargs": {"enable_thinking": True}}},
    ),
}


def test_requests_equal_those_of_openais_client(monkeypatch):
    import openai

    for case in product(SWITCHES, PICTURES, LIFTED, [None, "array", "object"]):
        provider, pictures, thinking, schema = case
        question = request(pictures, thinking)
        roots = {"array": {"type": "array", "items": action_schema()}}
        if pictures == 1:  # a single object cannot be a fleet's reply
            roots["object"] = flat_action_schema() if provider in ("openai", "openrouter") else action_schema()
        images: list[Any] = [
            {"type": "image_url", "image_url": {"url": "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()}}
            for jpeg in question.images_jpeg
        ]
        options: dict[str, Any] = dict(SWITCHES[provider][thinking])
        options["max_completion_tokens" if provider == "openai" else "max_tokens"] = 8192
        if schema in roots:
            options["response_format"] = response_format(roots[schema])
        with Recording(CHAT) as server, openai.OpenAI(api_key=KEY, base_url=server.url + "/v1") as client:
            client.chat.completions.create(
                model="maker/m",
                messages=[{"role": "user", "content": [{"type": "text", "text": TEXT}, *between(texts(), images)]}],
                temperature=0.4,
                **options,
            )
        (theirs,) = server.sent
        if provider == "openai":  # OpenAI's models differ: each row has its own reasoning options
            switches = dict(zip(("quick", "thinking"), SWITCHES[provider], strict=True))
            sent = ours(
                monkeypatch, question, "/v1", CHAT, provider=provider, name="maker/m", schema=schema, **switches
            )
        else:
            sent = ours(monkeypatch, question, "/v1", CHAT, provider=provider, name="maker/m", schema=schema)
        assert (sent.body, sent.path) == (theirs.body, theirs.path), case
        assert sent.headers["authorization"] == theirs.headers["authorization"] == f"Bearer {KEY}", case


CONTENT = b'{"candidates":[{"content":{"role":"model","parts":[{"text":"{}"}]},"finishReason":"STOP"}]}'


def camel(value: Any) -> Any:
    """Return JSON with camel-case names, as in the API's documentation. The API also accepts `mime_type` for
    `mimeType`."""
    if isinstance(value, dict):
        return {
            re.sub("_(.)", lambda m: m[1].upper(), key): inner if key == "responseJsonSchema" else camel(inner)
            for key, inner in value.items()
        }
    return [camel(inner) for inner in value] if isinstance(value, list) else value


def test_requests_equal_those_of_geminis_client(monkeypatch):
    """A request without a row has no reasoning option. The row is like the row of a Gemini model up to 2.5."""
    from google import genai
    from google.genai import types

    for case in product(PICTURES, LIFTED, [None, {"type": "array", "items": action_schema()}], [False, True]):
        pictures, thinking, schema, row = case
        question = request(pictures, thinking)
        parts: list[Any] = [
            types.Part(inline_data=types.Blob(data=jpeg, mime_type="image/jpeg")) for jpeg in question.images_jpeg
        ]
        config = types.GenerateContentConfig(temperature=0.4, top_p=0.95, top_k=40, max_output_tokens=8192)
        budget: Any = {"thinkingConfig": {"thinkingBudget": -1 if thinking else 0}}
        if row:
            config.thinking_config = types.ThinkingConfig(thinking_budget=-1 if thinking else 0)
        if schema:
            config.response_mime_type = "application/json"
            config.response_json_schema = schema
        with Recording(CONTENT) as server:
            client = genai.Client(api_key=KEY, http_options=types.HttpOptions(base_url=server.url))
            client.models.generate_content(model="gemini-x", contents=[TEXT, *between([*LABELS], parts)], config=config)
        (theirs,) = server.sent
        root = "array" if schema else None
        switch = {"thinking" if thinking else "quick": budget} if row else {}
        sent = ours(monkeypatch, question, "/v1", CONTENT, provider="gemini", name="gemini-x", schema=root, **switch)
        expected = camel(theirs.body)
        if schema:  # our client removes keywords that the API does not support; the vendor's does not
            go = expected["generationConfig"]["responseJsonSchema"]["items"]["anyOf"][0]
            assert go["properties"]["depth_m"].pop("exclusiveMinimum") == 0, case
        assert (sent.body, sent.path) == (expected, theirs.path), case
        assert sent.headers["x-goog-api-key"] == theirs.headers["x-goog-api-key"] == KEY, case
        assert KEY not in str({name: value for name, value in sent.headers.items() if name != "x-goog-api-key"}), case


MESSAGE = b'{"id":"1","type":"message","role":"assistant","model":"m","content":[{"type":"text","text":"{}"}],"stop_reason":"end_turn","usage":{"input_tokens":1,"output_tokens":1}}'  # noqa: E501


def test_requests_equal_those_of_anthropics_client(monkeypatch):
    """The vendor's client no longer has a temperature option. The test adds the paper's temperature as an extra field.

    Thinking is set as for older models, which have a temperature and a budget.
    """
    import anthropic
    from anthropic import transform_schema

    for case in product(PICTURES, LIFTED, [None, "object"], [0.4, None]):
        pictures, thinking, schema, temperature = case
        question = request(pictures, thinking)
        images: list[Any] = [
            {
                "type": "image",
                "source": {"type": "base64", "media_type": "image/jpeg", "data": base64.b64encode(jpeg).decode()},
            }
            for jpeg in question.images_jpeg
        ]
        lifted: dict[str, Any] = {"thinking": {"type": "enabled", "budget_tokens": 4096}}
        options: dict[str, Any] = {**lifted} if thinking else {}
        if schema and pictures == 1:  # a single object cannot be a fleet's reply
            options["output_config"] = {"format": {"type": "json_schema", "schema": transform_schema(action_schema())}}
        if temperature is not None and not thinking:
            options["extra_body"] = {"temperature": temperature}
        with Recording(MESSAGE) as server, anthropic.Anthropic(api_key=KEY, base_url=server.url) as client:
            client.messages.create(
                model="claude-x",
                max_tokens=8192,
                messages=[{"role": "user", "content": [{"type": "text", "text": TEXT}, *between(texts(), images)]}],
                **options,
            )
        (theirs,) = server.sent
        sent = ours(
            monkeypatch, question, "/v1", MESSAGE, provider="anthropic", name="claude-x", schema=schema,
            temperature=temperature, thinking=lifted,
        )  # fmt: skip
        assert (bare(sent.body), sent.path) == (bare(theirs.body), theirs.path), case
        # The API accepts both headers. Its documentation shows x-api-key; the vendor's client sends a bearer token.
        assert sent.headers["x-api-key"] == KEY, case
        assert theirs.headers["authorization"] == f"Bearer {KEY}", case
        assert KEY not in str({name: value for name, value in sent.headers.items() if name != "x-api-key"}), case
        if temperature is None:
            assert sent.headers["anthropic-version"] == theirs.headers["anthropic-version"], case


ROWS = {row.name: row.spec for row in rows().values()}


def of(provider: str) -> list[str]:
    return [name for name, spec in ROWS.items() if spec.provider == provider]


def sent_for(monkeypatch: pytest.MonkeyPatch, name: str, question: Request, base: str, answer: bytes) -> Sent:
    declared = asdict(ROWS[name])
    del declared["base_url"]  # the recording server has its own
    return ours(monkeypatch, question, base, answer, **declared)


@pytest.mark.parametrize("name", of("openai"))
@pytest.mark.parametrize("thinking", LIFTED)
def test_requests_of_openai_rows_equal_those_of_its_client(monkeypatch, name, thinking):
    """The reasoning effort must be one of the values that the client's type allows."""
    import openai
    from openai.types.shared.reasoning_effort import ReasoningEffort

    spec = ROWS[name]
    options: Any = spec.thinking if thinking else spec.quick
    assert options.get("reasoning_effort") in (None, *typing.get_args(typing.get_args(ReasoningEffort)[0]))
    url = "data:image/jpeg;base64," + base64.b64encode(JPEG).decode()
    with Recording(CHAT) as server, openai.OpenAI(api_key=KEY, base_url=server.url + "/v1") as client:
        client.chat.completions.create(
            model=spec.name,
            messages=[
                {
                    "role": "user",
                    "content": [{"type": "text", "text": TEXT}, {"type": "image_url", "image_url": {"url": url}}],
                }
            ],
            max_completion_tokens=8192,
            **options,
        )
    sent = sent_for(monkeypatch, name, Request(TEXT, (JPEG,), thinking), "/v1", CHAT)
    assert sent.body == server.sent[0].body


@pytest.mark.parametrize("name", of("gemini"))
@pytest.mark.parametrize("thinking", LIFTED)
def test_requests_of_gemini_rows_equal_those_of_its_client(monkeypatch, name, thinking):
    from google import genai
    from google.genai import types

    spec = ROWS[name]
    switch = (spec.thinking if thinking else spec.quick) or {}
    config = types.GenerateContentConfig(temperature=0.4, top_p=0.95, top_k=40, max_output_tokens=8192)
    if switch:
        level = switch["thinkingConfig"]["thinkingLevel"]
        assert level in types.ThinkingLevel.__members__
        config.thinking_config = types.ThinkingConfig(thinking_level=types.ThinkingLevel[level])
    picture: Any = types.Part(inline_data=types.Blob(data=JPEG, mime_type="image/jpeg"))
    with Recording(CONTENT) as server:
        client = genai.Client(api_key=KEY, http_options=types.HttpOptions(base_url=server.url))
        client.models.generate_content(model=spec.name, contents=[TEXT, picture], config=config)
    sent = sent_for(monkeypatch, name, Request(TEXT, (JPEG,), thinking), "/v1", CONTENT)
    assert (sent.body, sent.path) == (camel(server.sent[0].body), server.sent[0].path)


@pytest.mark.parametrize("name", of("anthropic"))
@pytest.mark.parametrize("thinking", LIFTED)
def test_requests_of_anthropic_rows_equal_those_of_its_client(monkeypatch, name, thinking):
    import anthropic
    from anthropic.types.model import Model

    spec = ROWS[name]
    assert spec.name in typing.get_args(typing.get_args(Model)[0])
    options: Any = spec.thinking if thinking else spec.quick
    with Recording(MESSAGE) as server, anthropic.Anthropic(api_key=KEY, base_url=server.url) as client:
        source: Any = {"type": "base64", "media_type": "image/jpeg", "data": base64.b64encode(JPEG).decode()}
        client.messages.create(
            model=spec.name,
            max_tokens=8192,
            messages=[
                {"role": "user", "content": [{"type": "text", "text": TEXT}, {"type": "image", "source": source}]}
            ],
            **options,
        )
    sent = sent_for(monkeypatch, name, Request(TEXT, (JPEG,), thinking), "/v1", MESSAGE)
    assert sent.body == server.sent[0].body
    assert sent.headers["anthropic-version"] == server.sent[0].headers["anthropic-version"]


@pytest.mark.parametrize("provider", ["openai", "vllm", "gemini", "anthropic"])
def test_a_commander_request_has_the_schema_of_orders(monkeypatch, provider):
    """The schema is in the vendor's field for it, whichever root the pilots' schema has."""
    from anthropic import transform_schema

    question = replace(request(4, False), role="commander")
    answers = {"gemini": CONTENT, "anthropic": MESSAGE}
    root = "object" if provider == "anthropic" else "array"
    sent = ours(
        monkeypatch, question, "/v1", answers.get(provider, CHAT), provider=provider, name="m", schema=root,
    )  # fmt: skip
    schema = orders_schema(4)
    if provider == "gemini":
        assert sent.body["generationConfig"]["responseMimeType"] == "application/json"
        assert sent.body["generationConfig"]["responseJsonSchema"] == schema
    elif provider == "anthropic":
        held = sent.body["output_config"]["format"]
        assert bare(held) == bare({"type": "json_schema", "schema": transform_schema(schema)})
    else:
        assert sent.body["response_format"] == response_format(schema)
    free = ours(monkeypatch, question, "/v1", answers.get(provider, CHAT), provider=provider, name="m")
    assert "additionalProperties" not in str(free.body)


def bare(body: Any) -> Any:
    """Return a request without the client's schema changes: descriptions, and the type of an enum."""
    if isinstance(body, dict):
        kept = {key: value for key, value in body.items() if key != "description"}
        return {key: bare(value) for key, value in kept.items() if not (key == "type" and "enum" in kept)}
    return [bare(value) for value in body] if isinstance(body, list) else body


@pytest.mark.parametrize(
    ("provider", "path"),
    [("local", "/v1/models"), ("gemini", "/v1/models?pageSize=1000"), ("anthropic", "/v1/models?limit=1000")],
)
def test_the_list_of_models_is_requested_in_the_longest_page(provider, path):
    with Recording(listed=b'{"data": [{"id": "m"}]}') as server:
        model = open_model(ModelSpec(provider=provider, name="m", base_url=server.url + "/v1"))
        assert model.listed() == ["m"]
        model.close()
    assert server.paths == [path]
