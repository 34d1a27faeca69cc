import json
import os
import subprocess
import sys

import pytest

from dronecats.cli.main import VERBS, main
from episodes import catalogue
from tests.support.command_line import DRONECATS

CONNECT = ["fly", "--connect", "udpin://127.0.0.1:0", "--instruction", "go to the van"]
MODEL = ["--model", "local/m", "--base-url", "http://127.0.0.1:1/v1"]
LIMITS = {"--cost-limit": "a number of $ above 0", "--token-limit": "a whole number of tokens, 1 or more"}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["fly"], "choose one vehicle"),
        (["fly", "--sitl", "--connect", "udpin://127.0.0.1:0"], "choose one vehicle"),
        (["fly", "--sitl", "--episode", "residental-approaching-01"], "residential-approaching-01"),
        (["fly", "--sitl", "--pilot", "visoin"], "did you mean vision"),
        (["fly", "--sitl", "--pilot", "vision", "--model", "openai/x"], "choose one pilot"),
        (["fly", "--sitl", "--model", "opnai/gpt"], "did you mean 'openai/…'"),
        (["fly", "--sitl", "--model", "local/x"], "needs --base-url"),
        (["fly", "--sitl", "--base-url", "http://127.0.0.1:1/v1"], "goes with --model"),
        (["fly", "--sitl", "--speed", "fast"], "--speed wants"),
        (["fly", "--sitl", "--speed", "0"], "--speed wants"),
        (["fly", "--sitl", "--speed", "max", "--latency", "real"], "no meaning with --speed max"),
        (["fly", "--sitl", "--latency", "fixed:x"], "--latency fixed:SECONDS wants"),
        (["fly", "--sitl", "--airframe", "x50"], "x500"),
        (["fly", "--connect", "udpin://127.0.0.1:0"], "--camera URL and --instruction"),
        (["fly", "--sitl", "--seed", "-1"], "--seed wants"),
        (["fly", "--sitl", "--seconds", "9"], "--seconds goes with --connect"),
        (["fly", "--connect", "udpin://127.0.0.1:0", "--speed", "max"], "--speed goes with --sitl"),
        (["fly", "--connect", "x", "--camera", "x", "--instruction", "x", "--seconds", "nan"], "--seconds wants"),
        (["fly", "--connect", "x", "--camera", "x", "--instruction", "x"], "'x' is no link"),
        ([*CONNECT, "--camera", "http://127.0.0.1:1/"], "gives no frame"),
        ([*CONNECT, "--camera", "x", "--no-envelope"], "--no-envelope goes with --sitl"),
        ([*CONNECT, "--camera", "x", "--arm", "--dry-run"], "--dry-run moves nothing"),
        ([*CONNECT, "--camera", "x", "--patience", "0.1"], "--patience wants"),
        ([*CONNECT, "--camera", "x", "--envelope", "nowhere.toml"], "nowhere.toml cannot be read"),
        (["fly", "--sitl", "--arm"], "--arm goes with --connect"),
        (["fly", "--sitl", "--dry-run"], "--dry-run goes with --connect"),
        (["fly", "--sitl", "--no-envelope", "--envelope", "x.toml"], "choose one"),
        (["fly", "--sitl", "--prompt", "/nowhere/prompt.txt"], "cannot be read"),
        *(
            (
                ["fly", "--sitl", *MODEL, option, value],
                f"{option} wants {wanted}, got '{value}'; without a limit, leave it out",
            )
            for option, wanted in LIMITS.items()
            for value in ("inf", "nan", "-1", "0", "much", "1e999", "")
        ),
        (["fly", "--sitl", *MODEL, "--token-limit", "2.5"], "--token-limit wants a whole number of tokens"),
        (["judge", "/nowhere"], "there is no folder"),
        (["judge", ".", "--delta", "-1"], "--delta wants"),
        (["sitl", "--instance", "1000"], "--instance wants"),
        (["sitl", "--count", "0"], "--count wants"),
        (["sitl", "--speed", "max"], "lockstep"),
        (["sitl", "--wind", "3"], "--wind wants"),
        (["sitl", "--wind", "nan,0"], "--wind wants"),
        (["sitl", "--gusts", "-1"], "--gusts wants"),
        (["sitl", "--gusts", "nan"], "--gusts wants"),
        (["sitl", "--faults", "nowhere.toml"], "nowhere.toml does not exist"),
    ],
)
def test_wrong_usage_is_one_sentence_and_status_2(arguments, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    said = capsys.readouterr().err.strip()
    assert sentence in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("verb", VERBS)
def test_what_a_verb_does_is_said_by_its_own_help_and_by_everybodys(verb, capsys):
    for arguments in ([verb, "--help"], ["--help"], ["--help", verb]):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 0
        assert VERBS[verb][1:] in " ".join(capsys.readouterr().out.split())


def test_an_api_key_that_is_missing_is_asked_for_by_its_variable(capsys, monkeypatch):
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    assert main(["fly", "--sitl", "--model", "openai/gpt-5"]) == 2
    assert "OPENAI_API_KEY" in capsys.readouterr().err


def test_an_unreachable_model_is_said_before_anything_starts(capsys, tmp_path):
    endpoint = ["--model", "local/m", "--base-url", "http://127.0.0.1:1/v1"]
    arguments = ["fly", "--sitl", *endpoint, "--out", str(tmp_path / "r")]
    assert main(arguments) == 2
    assert "model endpoint http://127.0.0.1:1/v1 cannot be reached" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


def test_a_camera_that_gives_no_frame_is_said_before_anything_moves(capsys, tmp_path):
    arguments = ["fly", "--connect", "udpin://127.0.0.1:0", "--camera", "http://127.0.0.1:1/frame.jpg",
                 "--instruction", "go to the car", "--out", str(tmp_path)]  # fmt: skip
    assert main(arguments) == 2
    assert not list(tmp_path.iterdir())
    assert "gives no frame" in capsys.readouterr().err


def test_a_malformed_episode_file_names_field_and_reason(capsys, tmp_path):
    record = tmp_path / "mine.json"
    record.write_text(json.dumps({"version": 1, "id": "mine"}))
    assert main(["fly", "--sitl", "--episode", str(record)]) == 2
    said = capsys.readouterr().err
    assert "mine.json" in said
    assert "missing" in said


def test_episodes_list_and_help_are_quick_and_complete(capsys):
    assert main(["episodes", "list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["episodes"]
    assert "residential-approaching-01" in {row["id"] for row in rows}
    heavy = "import sys; import dronecats.cli.main as m\ntry: m.main(['--help'])\nexcept SystemExit: pass\n"
    heavy += "print([n for n in ('numpy','numba','cv2','scipy','pymavlink','httpx') if n in sys.modules])"
    out = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True).stdout
    assert out.strip().endswith("[]")


def test_a_terminal_that_knows_few_characters_gets_what_it_can_show():
    command = [*DRONECATS, "episodes", "show", "blocks-commanding-01"]
    shown = subprocess.run(command, capture_output=True, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert shown.returncode == 0, shown.stderr
    bearing = catalogue.load("blocks-commanding-01").bearing_deg
    assert f"bearing {bearing:g}?".encode() in shown.stdout
