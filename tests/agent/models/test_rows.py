"""models.toml: requests match each row, users can add rows, and an error in a file is one sentence."""

import os
import pwd
import re
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.models import rows as model_rows
from dronecats.agent.models.model import Request
from dronecats.agent.models.rows import KEYS, SHIPPED, model_of, row_of, rows
from dronecats.agent.models.spec import PROVIDERS, spec_of
from dronecats.agent.models.wire_formats import open_model
from foundation.errors import UsageError
from tests.agent.models.recording import Recording
from tests.support.refusal import refusal

TEXT = files("dronecats.agent.models").joinpath(SHIPPED).read_text(encoding="utf-8")
TABLES = tomllib.loads(TEXT)
KEY = "sk-dummy-1234567890"
ANSWERS = {
    "openai": b'{"choices":[{"message":{"content":"{}"}}]}',
    "gemini": b'{"candidates":[{"content":{"parts":[{"text":"{}"}]}}]}',
    "anthropic": b'{"type":"message","content":[{"type":"text","text":"{}"}]}',
}
# paper, "Serving and Decoding" and "The Prompt": provider, identifier, root of the schema
PAPER = {
    "gpt-5": ("openai", "gpt-5", None),
    "claude-opus-5": ("openrouter", "anthropic/claude-opus-5", None),
    "gemini-3.7-flash": ("gemini", "gemini-3.7-flash", None),
    "gemini-robotics-er-2": ("gemini", "gemini-robotics-er-2-preview", None),
    "qwen3.5-27b": ("openrouter", "qwen/qwen3.5-27b", "array"),
    "qwen3.5-9b": ("openrouter", "qwen/qwen3.5-9b", "array"),
    "qwen3.5-4b": ("vllm", "Qwen/Qwen3.5-4B", "array"),
    "qwen3.5-2b": ("vllm", "Qwen/Qwen3.5-2B", "array"),
    "cosmos3-edge-2b": ("vllm", "nvidia/Cosmos3-Edge-2B", "array"),
}


@pytest.fixture(autouse=True)
def no_own_file(monkeypatch, tmp_path):
    """Isolate the tests from the user's own models file."""
    monkeypatch.delenv(model_rows.OWN_FILE, raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


@pytest.fixture
def own(monkeypatch, tmp_path):
    """Return a function that writes a text as the user's models file."""

    def write(text):
        path = tmp_path / "mine.toml"
        path.write_text(text, encoding="utf-8")
        monkeypatch.setenv(model_rows.OWN_FILE, str(path))
        return path

    return write


@pytest.mark.parametrize("lifted", [False, True], ids=["off", "lifted"])
@pytest.mark.parametrize("name", TABLES)
def test_requests_contain_the_options_of_their_row(monkeypatch, name, lifted):
    table, provider = TABLES[name], PROVIDERS[TABLES[name]["provider"]]
    if provider.key_variable:
        monkeypatch.setenv(provider.key_variable, KEY)
    with Recording(ANSWERS[provider.wire]) as server:
        model = open_model(model_of(name, server.url + "/v1"))
        model.ask(Request("text", (b"\xff\xd8jpeg",), lifted))
        model.close()
    (sent,) = server.sent
    fields = sent.body["generationConfig"] if provider.wire == "gemini" else sent.body
    identifier = (
        sent.path.split("/")[-1].removesuffix(":generateContent") if fields is not sent.body else fields["model"]
    )
    assert identifier == table["identifier"]
    switch = table.get("reasoning_lifted" if lifted else "reasoning_off")
    if switch is None:
        switch = provider.thinking if lifted else provider.quick
    assert {key: fields[key] for key in switch} == switch
    other = table.get("reasoning_off" if lifted else "reasoning_lifted", {})
    assert all(fields.get(key) == switch.get(key) for key in other)  # no option of the other switch
    assert fields.get("temperature") == (None if table.get("temperature") == "none" else provider.temperature)
    schema = (
        fields.get("response_format")
        or fields.get("responseJsonSchema")
        or fields.get("output_config", {}).get("format")
    )
    assert bool(schema) == (table.get("schema", "none") != "none")
    if schema and provider.wire == "openai":
        assert schema["json_schema"]["schema"]["type"] == "array" == table["schema"]
    assert KEY not in str(sent.body) + sent.path
    assert any(KEY in value for value in sent.headers.values()) == bool(provider.key_variable)


@pytest.mark.parametrize("lifted", [False, True], ids=["off", "lifted"])
@pytest.mark.parametrize("provider", ["openai", "gemini", "anthropic"])
def test_a_model_without_a_row_is_sent_only_options_common_to_its_providers_rows(monkeypatch, provider, lifted):
    """Some models of a provider reject fields of others. A model without a row gets only the common fields."""
    monkeypatch.setenv(str(PROVIDERS[provider].key_variable), KEY)
    request = Request("text", (b"\xff\xd8jpeg",), lifted)

    def sent(spec):
        model = open_model(replace(spec, name="any", schema=None))
        model.close()
        body = model.body(request)
        return {**body.pop("generationConfig", {}), **body, "headers": model.headers()}

    bare = sent(model_of(f"{provider}/quite-new"))
    specs = [row.spec for row in rows().values() if row.spec.provider == provider]
    assert len(specs) >= 3
    for spec in specs:
        assert bare.items() <= sent(spec).items()
    assert bare["headers"] == sent(specs[0])["headers"]


@pytest.mark.parametrize(("provider", "temperature"), [("openai", None), ("anthropic", None), ("gemini", 0.4)])
def test_a_row_without_a_temperature_has_its_providers_temperature(own, provider, temperature):
    own(f'[mine]\nprovider = "{provider}"\nidentifier = "m"\n')
    assert model_of("mine").temperature == model_of(f"{provider}/other").temperature == temperature
    own(f'[mine]\nprovider = "{provider}"\nidentifier = "m"\ntemperature = 0.3\n')
    assert model_of("mine").temperature == 0.3


def test_the_example_row_of_the_documentation_is_valid(own):
    page = (Path(__file__).parents[3] / "docs" / "models.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    own(text)
    spec = replace(rows()["my-gemini"].spec, base_url="http://127.0.0.1:9/v1")
    assert spec.provider == "gemini"
    open_model(spec).close()


def test_rows_of_the_papers_nine_models_match_the_paper():
    all_rows = rows()
    for name, (provider, identifier, schema) in PAPER.items():
        spec = all_rows[name].spec
        assert (spec.provider, spec.name, spec.schema) == (provider, identifier, schema)
        assert spec.axis_order == ("yx" if name.startswith("gemini") else "xy")
        assert (spec.temperature, spec.max_tokens) == (None if name == "gpt-5" else 0.4, 8192)


def test_a_price_has_input_and_output_and_a_dated_source():
    for row in rows().values():
        prices = row.spec.input_usd, row.spec.output_usd
        assert (prices[0] is None) == (prices[1] is None) == (row.source is None)
        assert row.source is None or re.search(r"\w\.\w+/.* 20\d\d-\d\d-\d\d$", row.source)


def test_rows_are_looked_up_by_name_or_by_identifier():
    all_rows = rows()
    assert model_of("gpt-5") == model_of("openai/gpt-5") == all_rows["gpt-5"].spec
    assert model_of("openai/gpt-5").temperature is None
    assert row_of("openrouter/maker/model", all_rows) is None
    assert model_of("openrouter/maker/model") == spec_of("openrouter/maker/model")
    assert model_of("gpt-5", "http://127.0.0.1:9/v1").base_url == "http://127.0.0.1:9/v1"
    with pytest.raises(UsageError, match=r"'gtp-5'.*'gpt-5'"):
        model_of("gtp-5")
    with pytest.raises(UsageError, match="quite-another"):
        model_of("quite-another")
    with pytest.raises(UsageError, match=r"'opneai'.*'openai'"):
        model_of("opneai/gpt-5")


def test_a_users_file_adds_rows_and_overrides_the_stated_fields(own):
    path = own("""
        [house]
        provider = "vllm"
        identifier = "maker/house-7b"
        base_url = "http://10.0.0.5:8000/v1"
        axis = "yx"
        schema = "object"
        temperature = "none"
        tokens_field = "max_completion_tokens"
        context = 32_000

        [gpt-5]
        input_usd = 1
    """)
    all_rows, shipped = rows(), TABLES
    assert all_rows.keys() == {*shipped, "house"}
    house, changed = all_rows["house"], all_rows["gpt-5"]
    assert (house.file, house.spec.title, house.spec.axis_order) == (str(path), "vllm/maker/house-7b", "yx")
    assert (house.spec.schema, house.spec.temperature, house.spec.context_tokens) == ("object", None, 32_000)
    with Recording(ANSWERS["openai"]) as server:
        model = open_model(model_of("house", server.url + "/v1"))
        model.ask(Request("text", (b"jpeg",), False))
        assert {"max_tokens", "max_completion_tokens", "temperature"} & server.sent[0].body.keys() == {
            "max_completion_tokens"
        }
    assert changed.file == str(path)
    assert (changed.spec.input_usd, changed.spec.output_usd, changed.spec.quick) == (
        1.0,
        10.0,
        {"reasoning_effort": "minimal"},
    )
    assert changed.source is None  # the source was for another price
    assert all_rows["gpt-6-luna"].file == SHIPPED


def test_two_rows_with_one_identifier_are_selected_by_name(own):
    own('[careful]\nprovider = "openai"\nidentifier = "gpt-5"\nreasoning_off = {reasoning_effort = "high"}')
    assert model_of("careful").quick == {"reasoning_effort": "high"}
    assert model_of("gpt-5").quick == {"reasoning_effort": "minimal"}
    with pytest.raises(UsageError, match="gpt-5, careful"):
        model_of("openai/gpt-5")


def test_location_of_the_users_file(monkeypatch, tmp_path):
    folder = tmp_path / "config" / "dronecats"
    folder.mkdir(parents=True)
    (folder / "models.toml").write_text('[mine]\nprovider = "local"\nidentifier = "m"\n')
    assert rows()["mine"].file == str(folder / "models.toml")
    monkeypatch.setenv("XDG_CONFIG_HOME", "")
    monkeypatch.setenv("HOME", str(tmp_path / "nowhere"))
    assert model_rows.own_file() == tmp_path / "nowhere" / ".config" / "dronecats" / "models.toml"
    assert rows().keys() == TABLES.keys()
    monkeypatch.setenv(model_rows.OWN_FILE, str(tmp_path / "gone.toml"))
    with pytest.raises(UsageError, match=r"DRONECATS_MODELS.*gone\.toml"):
        rows()
    monkeypatch.setenv(model_rows.OWN_FILE, str(tmp_path))
    with pytest.raises(UsageError, match=re.escape(str(tmp_path))):
        rows()


def test_a_user_without_a_home_has_the_shipped_rows(monkeypatch):
    def nobody(uid):
        raise KeyError(uid)

    for name in ("HOME", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", nobody)
    assert model_rows.own_file() is None
    assert rows().keys() == TABLES.keys()


GOOD = '[m]\nprovider = "vllm"\nidentifier = "x"\n'


MALFORMED: list[tuple[str, tuple[str, ...]]] = [
    ("[m", ("TOML",)),
    ("provider = 'vllm'", ("'provider'", "[NAME]")),
    ("['a b']", ("'a b'",)),
    ("['a/b']", ("'a/b'",)),
    ("[m]\nprovider = 'vllm'", ("[m]", "identifier")),
    ("[m]\nidentifier = 'x'", ("[m]", "provider")),
    ("[qwen3.5-9b]\nprovider = 'vllm'", ("'5-9b'",)),
    (f"{GOOD}temprature = 0.2", ("[m]", "'temprature'", "'temperature'")),
    (f"{GOOD}quite = 0.2", ("[m]", "'quite'", "provider, identifier")),
    ("[m]\nprovider = 'vlm'\nidentifier = 'x'", ("[m]: 'provider'", "'vlm'", "vllm")),
    ("[m]\nprovider = 3", ("[m]: 'provider'", "3")),
    ("[m]\nidentifier = ' '", ("[m]: 'identifier'", "' '")),
    (f"{GOOD}axis = 'xz'", ("[m]: 'axis'", "xy", "yx", "'xz'")),
    (f"{GOOD}schema = 'aray'", ("[m]: 'schema'", '"object"', '"array"', "'aray'")),
    (f"{GOOD}schema = false", ("[m]: 'schema'", "False")),
    (f"{GOOD}temperature = 3", ("[m]: 'temperature'", "2", '"none"')),
    (f"{GOOD}temperature = true", ("[m]: 'temperature'",)),
    (f"{GOOD}temperature = nan", ("[m]: 'temperature'",)),
    (f"{GOOD}max_tokens = 0", ("[m]: 'max_tokens'", "100,000,000", "0")),
    (f"{GOOD}max_tokens = 1.5", ("[m]: 'max_tokens'",)),
    (f"{GOOD}top_p = 1.5", ("[m]: 'top_p'", "1.5")),
    (f"{GOOD}input_usd = -1", ("[m]: 'input_usd'", "100,000")),
    (f"{GOOD}input_usd = inf", ("[m]: 'input_usd'",)),
    (f"{GOOD}input_usd = '5'", ("[m]: 'input_usd'",)),
    (f"{GOOD}tokens_field = 'tokens'", ("[m]: 'tokens_field'", "max_tokens", "max_completion_tokens")),
    (f"{GOOD}reasoning_off = 'none'", ("[m]: 'reasoning_off'",)),
    (f"{GOOD}reasoning_off = {{ a = nan }}", ("[m]: 'reasoning_off.a'",)),
    (f"{GOOD}reasoning_off = {{ a = [2026-01-01] }}", ("[m]: 'reasoning_off'",)),
    ("[gpt-5]\nprovider = 'gemini'\ntokens_field = 'max_tokens'", ("tokens_field",)),
    ("#" * 1_000_001, ("1000000",)),
    (f"{GOOD}top_k = {'1' * 5000}", ("TOML",)),
    (f"{GOOD}top_k = 0x{'f' * 5000}", ("[m]: 'top_k'",)),
    (f"{GOOD}reasoning_off = {{ a = 0x{'f' * 5000} }}", ("[m]: 'reasoning_off'",)),
]


def test_errors_in_a_file_are_one_sentence_with_file_row_and_key(own):
    for text, words in MALFORMED:
        path = own(text)
        message = refusal(rows)
        assert [word for word in (str(path), *words) if word not in message] == [], text[:80]
        assert "\n" not in message, text[:80]


def test_a_binary_file_is_rejected(own):
    path = own("")
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match=re.escape(str(path))):
        rows()


VALUES = st.recursive(
    st.one_of(st.text(max_size=8).map(repr), st.integers().map(str), st.sampled_from(["true", "nan", "1979-05-27"])),
    lambda inner: st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]"),
    max_leaves=4,
)


@given(st.dictionaries(st.sampled_from([*KEYS, "other"]), VALUES, max_size=6))
def test_any_row_is_valid_or_gives_a_one_line_error(tmp_path_factory, fields):
    path = tmp_path_factory.mktemp("rows") / "own.toml"
    path.write_text("[m]\n" + "".join(f"{key} = {value}\n" for key, value in fields.items()), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(os.environ, model_rows.OWN_FILE, str(path))
        try:
            outcome: object = rows()["m"].spec.provider
        except UsageError as error:
            outcome = error
    if isinstance(outcome, UsageError):
        assert str(outcome).startswith(str(path))
        assert "\n" not in str(outcome)
    else:
        assert outcome in PROVIDERS


def test_a_file_in_the_home_of_an_unknown_user_is_an_error(monkeypatch):
    monkeypatch.setenv(model_rows.OWN_FILE, "~nobody-has-this-name/models.toml")
    with pytest.raises(UsageError, match="~nobody-has-this-name"):
        rows()
