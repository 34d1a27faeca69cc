"""The command `dronecats models`: the output and exit status of list, show and check. No output contains a key."""

import json
import re

import pytest

from dronecats.agent.models.rows import OWN_FILE, rows
from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import main, parse
from dronecats.flight.spec.spec_file import as_redacted_json
from tests.agent.flown_wire import Endpoint
from tests.agent.flown_wire import fly as first_step
from tests.agent.models.pointing import FORMATS, Pointer, mark, wrapped
from tests.agent.models.recording import Recording

KEY = "sk-cli-SECRET-0987654321"


@pytest.fixture(autouse=True)
def no_models_file(monkeypatch, tmp_path):
    monkeypatch.delenv(OWN_FILE, raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


@pytest.fixture
def house(monkeypatch, tmp_path):
    """A models file with one row."""
    path = tmp_path / "mine.toml"
    path.write_text(
        '[house]\nprovider = "vllm"\nidentifier = "maker/house"\naxis = "yx"\nschema = "array"\n'
        "temperature = 0.1\ninput_usd = 1\noutput_usd = 2\n",
        encoding="utf-8",
    )
    monkeypatch.setenv(OWN_FILE, str(path))
    return path


def test_the_list_shows_each_row_with_its_file_and_the_presence_of_its_key(monkeypatch, capsys, house):
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.delenv("ANTHROPIC_API_KEY", raising=False)
    assert main(["models", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    of = {line.split()[0]: line for line in lines[2:]}  # below the header and its rule
    assert of.keys() == rows().keys()
    assert of["house"].endswith(str(house))
    assert "[y, x]" in of["house"]
    assert "array" in of["house"]
    assert "OPENAI_API_KEY  " in of["gpt-5"]
    assert re.search(r"ANTHROPIC_API_KEY +no\b", of["claude-opus-5-5"])
    assert re.search(r"VLLM_API_KEY +-", of["qwen3.5-4b"])  # a local server needs no key
    assert main(["models", "list", "--json"]) == 0
    output = capsys.readouterr().out
    by_name = {row["name"]: row for row in json.loads(output)["models"]}
    assert (by_name["gpt-5"]["key_set"], by_name["claude-opus-5-5"]["key_set"]) == (True, False)
    assert by_name["house"]["output_usd"] == 2.0
    assert KEY not in output + "".join(lines)


@pytest.mark.parametrize("name", ["gpt-5", "gemini-3.7-flash", "claude-opus-5-5", "qwen3.5-4b", "openrouter/maker/m"])
def test_show_prints_the_sent_request_and_needs_no_key(monkeypatch, capsys, name):
    for provider in ("OPENAI", "GEMINI", "ANTHROPIC", "VLLM", "OPENROUTER"):
        monkeypatch.delenv(f"{provider}_API_KEY", raising=False)
    assert main(["models", "show", name, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    with Recording(Pointer("as declared")) as server:
        assert main(["models", "check", name, "--base-url", server.url + "/v1"]) == 0
    capsys.readouterr()
    sent = server.sent[0]
    prefix = shown["request"]["url"].partition("/v1")[0]  # OpenRouter's path begins with /api
    assert shown["request"]["url"].removeprefix(prefix).removeprefix("/api") == sent.path
    assert outline(shown["request"]["body"]) == outline(sent.body)
    assert (shown["row"] is None) == (name == "openrouter/maker/m")
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    assert main(["models", "show", name]) == 0
    output = capsys.readouterr().out
    assert "base64>" in output
    assert ("[y, x]" in output) == ("gemini" in name)
    assert len(output) < 12_000
    assert KEY not in output


def outline(value):
    """Return a request without its long texts (prompts and images)."""
    if isinstance(value, dict):
        return {key: outline(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [outline(inner) for inner in value]
    return "…" if isinstance(value, str) and ("JPEG" in value or len(value) > 100) else value


def test_show_lifted_prints_the_request_with_reasoning_on(capsys):
    main(["models", "show", "gpt-5", "--json", "--lifted"])
    assert json.loads(capsys.readouterr().out)["request"]["body"]["reasoning_effort"] == "medium"


def test_show_removes_secrets_from_the_address(capsys):
    url = "http://me:hush-hush@127.0.0.1:9/v1?key=topsecretkey123456"
    assert main(["models", "show", "local/x", "--base-url", url]) == 0
    output = capsys.readouterr().out
    assert "127.0.0.1:9/v1/chat/completions?key=***" in output
    assert "hush" not in output
    assert "topsecret" not in output


def test_a_check_reports_the_replies_and_that_the_model_can_fly(capsys, house):
    with Recording(Pointer("always [y, x]", enforces=True)) as server:
        assert main(["models", "check", "house", "--base-url", server.url + "/v1"]) == 0
    output = capsys.readouterr().out
    assert server.sent[0].body["temperature"] == 0.1
    for part in (r"\b100\b.*\b20\b", r"Points: .*\[y, x\]", "Schema: enforced", r"\$0\.000560", r"\b400 .*\b80 "):
        assert re.search(part, output), part


def test_a_check_reports_why_a_reply_is_unfinished(capsys):
    def cut_off(sent):
        reply = wrapped("openai", '{"acti', 100, 8192)
        reply["choices"][0]["finish_reason"] = "length"
        return 200, json.dumps(reply).encode()

    with Recording(cut_off) as server:
        words = ["models", "check", "local/m", "--base-url", server.url + "/v1"]
        assert main(words) == 1
        assert re.search(r"Unfinished: .*8,192 tokens.*max_tokens", capsys.readouterr().out)
        assert main([*words, "--json"]) == 1
    assert {question["finish"] for question in json.loads(capsys.readouterr().out)["asked"]} == {"length"}


def test_a_model_with_the_wrong_axis_order_cannot_fly_and_the_remedy_is_shown(capsys):
    with Recording(Pointer("always [y, x]")) as server:
        words = ["models", "check", "local/m", "--base-url", server.url + "/v1"]
        assert main(words) == 1
        assert "--axis yx" in capsys.readouterr().out
        assert main([*words, "--axis", "yx"]) == 0
        assert main([*words, "--json", "--schema", "array"]) == 1
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["pointing"], report["can_fly"]) == ("always [y, x]", False)
    assert (report["schema"], report["schema_enforced"]) == ("array", False)
    assert report["cost_usd"] is None


def test_a_failing_endpoint_makes_check_exit_with_3(monkeypatch, capsys):
    monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
    with Recording(f"wrong key {KEY}".encode(), 401) as server:
        assert main(["models", "check", "claude-opus-5-5", "--base-url", server.url + "/v1"]) == 3
    error = capsys.readouterr().err
    assert re.search(r"401 .*/messages: wrong key \*\*\*", error), error
    assert KEY not in error


def test_wrong_words_are_one_sentence_and_status_2(monkeypatch, capsys):
    for words, parts in (
        (["check", "gtp-5"], "'gpt-5'"),
        (["show", "gtp-5"], "'gpt-5'"),
        (["check", "claude-opus-5-5", "--schema", "array"], "object"),
        (["check", "local/m"], "--base-url"),
        (["check", "gpt-5"], "OPENAI_API_KEY"),
        (["show", "gpt-5", "--temperature", "warm"], "--temperature .*0 .*2, .*none.* .*'warm'"),
    ):
        monkeypatch.delenv("OPENAI_API_KEY", raising=False)
        monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
        assert main(["models", *words]) == 2, words
        captured = capsys.readouterr()
        assert re.search(parts, captured.err), captured.err
        assert captured.out == "", words


def test_doctor_counts_the_models(capsys, house):
    main(["doctor", "--json"])
    findings = {finding["name"]: finding for finding in json.loads(capsys.readouterr().out)["findings"]}
    assert re.search(rf"\b{len(rows())} .*\b1 .*{house}", findings["models"]["detail"])


def test_an_invalid_models_file_stops_model_commands_and_doctor_reports_it(capsys, house):
    house.write_text('[house]\nprovidr = "vllm"\n', encoding="utf-8")
    for words in (["models", "list"], ["models", "check", "gpt-5"], ["fly", "--sitl", "--model", "gpt-5"]):
        assert main(words) == 2
        assert re.search(r"mine\.toml: \[house\].*'providr'.*'provider'", capsys.readouterr().err)
    assert main(["doctor"]) == 0
    assert "'providr'" in capsys.readouterr().out


def model_of(*words):
    """Return the model of the flight that a command line configures."""
    model = spec_of(parse(["fly", "--sitl", *words])).model
    assert model
    return model


def test_a_flight_uses_the_row_and_options_override_it(house):
    model = model_of("--model", "house")
    assert (model.axis_order, model.schema, model.temperature, model.output_usd) == ("yx", "array", 0.1, 2.0)
    assert model_of("--model", "vllm/maker/house") == model
    words = ["--axis", "xy", "--schema", "none", "--temperature", "none", "--base-url", "http://127.0.0.1:9/v1"]
    model = model_of("--model", "house", *words)
    assert (model.axis_order, model.schema, model.temperature) == ("xy", None, None)
    assert (model.base_url, model.output_usd) == ("http://127.0.0.1:9/v1", 2.0)
    assert model_of("--model", "gpt-5", "--temperature", "1").temperature == 1.0


def test_a_repeated_flight_does_not_need_the_models_file(monkeypatch, tmp_path, house):
    spec = spec_of(parse(["fly", "--sitl", "--model", "house"]))
    (tmp_path / "run.json").write_text(json.dumps({"versions": {}, "flight": as_redacted_json(spec)}))
    monkeypatch.setenv(OWN_FILE, str(tmp_path / "gone.toml"))
    again = ["fly", "--spec", str(tmp_path / "run.json"), "--episode", "residential-approaching-01"]
    assert spec_of(parse(again)).model == spec.model


def test_model_options_need_a_model(capsys):
    for option in (["--axis", "yx"], ["--schema", "object"], ["--temperature", "none"]):
        assert main(["fly", "--sitl", *option]) == 2, option
        assert re.search(f"{option[0]} .*--model", capsys.readouterr().err), option


def test_a_flight_prints_the_request_options_of_its_model(capsys, house):
    assert main(["fly", "--sitl", "--speed", "max", "--model", "local/x", "--axis", "yx", "--temperature", "none"]) == 2
    captured = capsys.readouterr()
    assert re.search(r"local/x\b.*\[y, x\].*schema.*temperature", captured.out)
    assert "--base-url" in captured.err


def test_show_prints_the_request_of_the_agents_first_step(capsys, tmp_path):
    with Endpoint(['{"action": "think"}']) as endpoint:
        first_step(endpoint, tmp_path / "flight", steps=1)
        assert main(["models", "show", "openrouter/maker/model-1", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["request"]["body"]
    (sent,) = endpoint.bodies
    assert shown["messages"][0]["content"][0] == sent["messages"][0]["content"][0]
    assert outline(shown) == outline(sent)


SENT: dict[str, dict[str, object]] = {
    "openai/m": {"reasoning_effort": "low"},
    "gpt-5": {"reasoning_effort": "low"},
    "openrouter/maker/m": {"reasoning": {"effort": "low"}},
    "qwen3.5-9b": {"reasoning": {"effort": "low"}, "provider": {"require_parameters": True}},
    "vllm/m": {"reasoning_effort": "low", "chat_template_kwargs": {"enable_thinking": True}},
    "anthropic/m": {"output_config": {"effort": "low"}},
}


@pytest.mark.parametrize("name", SENT)
def test_reasoning_effort_uses_the_request_field_of_each_vendor(capsys, name):
    def shown(*words):
        assert main(["models", "show", name, "--json", *words]) == 0
        return json.loads(capsys.readouterr().out)["request"]["body"]

    body = shown("--reasoning-effort", "low")
    assert {key: body[key] for key in SENT[name]} == SENT[name]
    assert shown("--reasoning-effort", "low", "--lifted") == shown("--lifted")


def test_gemini_gets_an_uppercase_thinking_level_with_max_tokens_and_top_p(capsys):
    words = ["--reasoning-effort", "low", "--max-tokens", "512", "--top-p", "0.5"]
    assert main(["models", "show", "gemini-3.7-flash", "--json", *words]) == 0
    config = json.loads(capsys.readouterr().out)["request"]["body"]["generationConfig"]
    assert config["thinkingConfig"] == {"thinkingLevel": "LOW"}
    assert (config["maxOutputTokens"], config["topP"]) == (512, 0.5)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--max-tokens", "0"], "--max-tokens .*1 .*0"),
        (["--max-tokens", "many"], "--max-tokens .*'many'"),
        (["--top-p", "1.5"], "--top-p .*1.5.* 0 … 1"),
        (["--reasoning-effort", "low;"], "--reasoning-effort .*'low;'"),
    ],
)
def test_invalid_request_options_are_rejected(capsys, words, parts):
    assert main(["models", "show", "gpt-5", *words]) == 2
    assert re.search(parts, capsys.readouterr().err)


def test_a_check_uses_the_parser_option(capsys):
    def fenced(sent):
        text, jpeg, _ = FORMATS["openai"](sent.body)
        x, y = mark(jpeg)
        point = [round(x), round(y)] if '"point": [x, y]' in text else [round(y), round(x)]
        reply_text = json.dumps({"action": "go", "point": point, "depth_m": "5"})  # a string instead of a number
        return 200, json.dumps(wrapped("openai", reply_text, 10, 5)).encode()

    with Recording(fenced) as server:
        words = ["models", "check", "local/m", "--base-url", server.url + "/v1"]
        assert main(words) == 1
        assert main([*words, "--parser", "lenient"]) == 0


LISTS = {"data": [{"id": "maker/model-1"}, {"id": "maker/model-2"}]}, {"models": [{"name": "models/maker/model-1"}]}


@pytest.mark.parametrize("listed", LISTS, ids=["OpenAI", "Gemini"])
def test_the_models_of_a_server_are_listed(capsys, listed):
    with Recording(listed=json.dumps(listed).encode()) as server:
        assert main(["models", "list", "--endpoint", server.url + "/v1"]) == 0
        assert "maker/model-1" in capsys.readouterr().out.splitlines()
        assert main(["models", "list", "--endpoint", server.url + "/v1", "--json"]) == 0
    assert "maker/model-1" in json.loads(capsys.readouterr().out)["models"]


def test_a_server_without_a_model_list_prints_one_error_and_exits_with_3(capsys):
    for server in (Recording(), Recording(listed=b"<html>")):
        with server:
            assert main(["models", "list", "--endpoint", server.url + "/v1"]) == 3
        error = capsys.readouterr().err
        assert len(error.splitlines()) == 1
        assert server.url in error


def test_an_unknown_model_gets_suggestions(capsys):
    with Recording(b'{"error": "no such model"}', 404, listed=json.dumps(LISTS[0]).encode()) as server:
        assert main(["models", "check", "local/maker/modle-1", "--base-url", server.url + "/v1"]) == 3
        assert "maker/model-1" in capsys.readouterr().err
