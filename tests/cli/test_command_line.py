import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from dronecats.cli.main import EXAMPLES, VERBS, main, parse
from episodes.records import catalogue
from tests.report.results.synthetic_runs import write_run
from tests.support.command_line import DRONECATS

CONNECT = ["fly", "--connect", "udpin://127.0.0.1:0", "--instruction", "go to the van"]
MODEL = ["--model", "local/m", "--base-url", "http://127.0.0.1:1/v1"]


def test_invalid_usage_prints_one_sentence_and_exits_with_2(capsys, tmp_path, monkeypatch):
    for arguments, parts in (
        (["fly"], "--sitl .*--connect"),
        (["fly", "--sitl", "--connect", "udpin://127.0.0.1:0"], "--sitl .*--connect"),
        (["fly", "--sitl", "--episode", "residental-approaching-01"], "residential-approaching-01"),
        (["fly", "--sitl", "--pilot", "visoin"], "visoin.*vision"),
        (["fly", "--sitl", "--pilot", "vision", "--model", "openai/x"], "--pilot .*--model"),
        (["fly", "--sitl", "--model", "opnai/gpt"], "opnai.*openai"),
        (["fly", "--sitl", "--model", "local/x"], "local.*--base-url"),
        (["fly", "--sitl", "--base-url", "http://127.0.0.1:1/v1"], "--base-url .*--model"),
        (["fly", "--sitl", "--speed", "fast"], "--speed .*fast"),
        (["fly", "--sitl", "--speed", "0"], "--speed .*0"),
        (["fly", "--sitl", "--speed", "max", "--latency", "real"], "--latency real .*--speed max"),
        (["fly", "--sitl", "--latency", "fixed:x"], "--latency fixed:SECONDS"),
        (["fly", "--sitl", "--airframe", "x50"], "x500"),
        (["fly", "--connect", "udpin://127.0.0.1:0"], "--camera .*--instruction"),
        (["fly", "--sitl", "--seed", "-1"], "--seed .*-1"),
        (["fly", "--sitl", "--sign", "key"], "--sign .*--connect"),
        ([*CONNECT, "--camera", "x", "--sign", "no-such-key"], "--sign no-such-key"),
        (["preflight", "--connect", "x", "--sign", "no-such-key"], "--sign no-such-key"),
        (["preflight", "--connect", "x", "--give-key"], "--give-key .*--sign"),
        (["sitl", "--sign", "no-such-key"], "--sign no-such-key"),
        (["fly", "--sitl", "--seconds", "9"], "--seconds .*--connect"),
        (["fly", "--connect", "udpin://127.0.0.1:0", "--speed", "max"], "--speed .*--sitl"),
        (["fly", "--connect", "x", "--camera", "x", "--instruction", "x", "--seconds", "nan"], "--seconds .*nan"),
        (["fly", "--connect", "x", "--camera", "x", "--instruction", "x"], "'x'"),
        ([*CONNECT, "--camera", "http://127.0.0.1:1/"], "http://127.0.0.1:1/"),
        ([*CONNECT, "--camera", "x", "--no-envelope"], "--no-envelope .*--sitl"),
        ([*CONNECT, "--camera", "x", "--arm", "--dry-run"], "--dry-run .*--arm"),
        ([*CONNECT, "--camera", "x", "--patience", "0.1"], "--patience .*0.1"),
        ([*CONNECT, "--camera", "x", "--envelope", "nowhere.toml"], "nowhere.toml"),
        (["fly", "--sitl", "--arm"], "--arm .*--connect"),
        (["fly", "--sitl", "--dry-run"], "--dry-run .*--connect"),
        (["fly", "--sitl", "--no-envelope", "--envelope", "x.toml"], "--no-envelope .*--envelope"),
        (["fly", "--sitl", "--prompt", "/nowhere/prompt.txt"], "/nowhere/prompt.txt"),
        *(
            (["fly", "--sitl", *MODEL, option, value], f"{option} .*'{value}'")
            for option in ("--cost-limit", "--token-limit")
            for value in ("inf", "nan", "-1", "0", "much", "1e999", "")
        ),
        (["fly", "--sitl", *MODEL, "--token-limit", "2.5"], "--token-limit .*2.5"),
        (["judge", "/nowhere"], "/nowhere"),
        (["judge", ".", "--delta", "-1"], "--delta .*-1"),
        (["sitl", "--instance", "1000"], "--instance .*1000"),
        (["sitl", "--count", "0"], "--count .*0"),
        (["sitl", "--speed", "max"], "lockstep"),
        (["sitl", "--wind", "3"], "--wind .*3"),
        (["sitl", "--wind", "nan,0"], "--wind .*nan,0"),
        (["sitl", "--wind", "31,0"], "wind .*0 to 30 m/s, got 31"),
        (["sitl", "--gusts", "-1"], "gusts .*-1"),
        (["sitl", "--gusts", "nan"], "gusts .*nan"),
        (["sitl", "--faults", "nowhere.toml"], "nowhere.toml"),
    ):
        monkeypatch.chdir(tmp_path)
        assert main(arguments) == 2, arguments
        error = capsys.readouterr().err.strip()
        assert re.search(parts, error), error
        assert len(error.splitlines()) == 1, arguments


def test_each_verb_is_described_in_its_own_help_and_in_the_main_help(capsys):
    for verb in VERBS:
        for arguments in ([verb, "--help"], ["--help"], ["--help", verb]):
            with pytest.raises(SystemExit) as ended:
                main(arguments)
            assert ended.value.code == 0, verb
            assert VERBS[verb][1:] in " ".join(capsys.readouterr().out.split()), verb


def test_each_example_can_be_parsed_and_each_verb_has_examples(capsys):
    examples = [shlex.split(line) for line in EXAMPLES.read_text().splitlines()]
    for program, *words in examples:
        assert program == "dronecats"
        assert parse(words).verb == words[0]
    assert [verb for verb in VERBS if sum(words[1] == verb for words in examples) < (verb != "prompt") + 1] == []
    for words in (["film"], ["episodes", "probe"]):
        with pytest.raises(SystemExit):
            main([*words, "--help"])
        *_, heading, text = capsys.readouterr().out.partition("examples:\n")
        assert heading
        assert all(line.startswith(f"  dronecats {' '.join(words)} ") for line in text.splitlines())


def test_the_error_for_a_missing_api_key_names_its_variable(capsys, monkeypatch):
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    assert main(["fly", "--sitl", "--model", "openai/gpt-5"]) == 2
    assert "OPENAI_API_KEY" in capsys.readouterr().err


def test_an_unreachable_model_is_reported_before_the_start(capsys, tmp_path):
    endpoint = ["--model", "local/m", "--base-url", "http://127.0.0.1:1/v1"]
    arguments = ["fly", "--sitl", *endpoint, "--out", str(tmp_path / "r")]
    assert main(arguments) == 2
    assert "http://127.0.0.1:1/v1" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


def test_a_camera_without_frames_is_reported_before_the_start(capsys, tmp_path):
    arguments = ["fly", "--connect", "udpin://127.0.0.1:0", "--camera", "http://127.0.0.1:1/frame.jpg",
                 "--instruction", "go to the car", "--out", str(tmp_path)]  # fmt: skip
    assert main(arguments) == 2
    assert not list(tmp_path.iterdir())
    assert "http://127.0.0.1:1/frame.jpg" in capsys.readouterr().err


def test_the_error_for_a_malformed_episode_file_names_file_and_field(capsys, tmp_path):
    record = tmp_path / "mine.json"
    record.write_text(json.dumps({"version": 1, "id": "mine"}))
    assert main(["fly", "--sitl", "--episode", str(record)]) == 2
    error = capsys.readouterr().err
    assert re.search(r"mine\.json.*'\w+'", error)


def test_episodes_list_works_and_help_imports_no_heavy_packages(capsys):
    assert main(["episodes", "list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["episodes"]
    assert "residential-approaching-01" in {row["id"] for row in rows}
    heavy = "import sys; import dronecats.cli.main as m\ntry: m.main(['--help'])\nexcept SystemExit: pass\n"
    heavy += "print([n for n in ('numpy','numba','cv2','scipy','pymavlink','httpx') if n in sys.modules])"
    out = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True).stdout
    assert out.strip().endswith("[]")


def test_an_ascii_terminal_gets_replacement_characters():
    command = [*DRONECATS, "episodes", "show", "blocks-commanding-01"]
    shown = subprocess.run(command, capture_output=True, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert shown.returncode == 0, shown.stderr
    bearing = catalogue.load("blocks-commanding-01").bearing_deg
    assert f" {bearing:g}?".encode() in shown.stdout


@pytest.mark.parametrize(
    ("words", "near"),
    [
        (["flly"], "'fly'"),
        (["models", "chek"], "'check'"),
        (["judge", "runs", "--dleta", "3"], "'--delta'"),
        (["maps", "list", "--jsno"], "'--json'"),
        (["study", "latency", "--cells", "tracking", "--pilot", "oracle", "--hold", "wnid=3"], "'wind'"),
        (["study", "latency", "--pilot", "oracle", "--cells", "traking"], "'tracking'"),
        (["fly", "--sitl", "--model", "gpt6"], "gpt-6"),
        (["fly", "--sitl", "--pilot", "orakle"], "'oracle'"),
        (["fly", "--sitl", "--episode", "residentail-approaching-01"], "'residential-approaching-01'"),
        (["fly", "--sitl", "--pilot", "blind:rinng"], "'blind:ring'"),
        (["fly", "--sitl", "--pilot", "failing:declares-erly"], "'failing:declares-early'"),
        (["fly", "--sitl", "--model", "opneai/gpt-6"], "'openai'"),
        (["fly", "--sitl", "--airframe", "x50"], "'x500'"),
        (["fly", "--sitl", "--agent", "steddy"], "'steady'"),
        (["fly", "--sitl", "--latency", "fixd:1"], "'fixed:SECONDS'"),
        (["fly", "--sitl", "--link", "dlay=0.1"], "'delay'"),
        (["fly", "--sitl", "--wnid", "1,2"], "'--wind'"),
        (["fly", "--sitl", "--optics", "optics.toml"], "'haze'"),
        (["sitl", "--faults", "faults.toml"], "'kind'"),
        (["bench", "typo.toml"], "'pilot'"),
        (["bench", "--suite", "quik", "--pilot", "oracle"], "'quick'"),
        (["maps", "show", "blcks"], "'blocks'"),
        (["edit", "residental"], "'residential'"),
        (["episodes", "sheet", "suvv", "--out", "sheet.jpg"], "'suv'"),
        (["study", "loop", "--loops", "roll rte"], "'roll rate'"),
        (["report", "runs", "--out", "report", "--exclude-above", "hist=2"], "'hits'"),
        (["query", "SELECT outcom FROM episodes", "runs"], "'outcome'"),
        (["query", "SELECT * FROM episods", "runs"], "'episodes'"),
        (["export", "runs", "--to", "mcp"], "'mcap'"),
    ],
)
def test_a_mistyped_name_gets_a_suggestion(words, near, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("typo.toml").write_text('pilto = ["oracle"]\n\n')
    Path("optics.toml").write_text("[hase]\n")
    Path("faults.toml").write_text('[[fault]]\nknid = "fail"\n')
    write_run(tmp_path / "runs" / "oracle", ("campus-searching-01",))
    with pytest.raises(SystemExit, match="2"):  # raised by argparse, or at the end of the program
        sys.exit(main(words))
    error = capsys.readouterr().err
    assert re.search(f"did you mean .*{near}", error), error
