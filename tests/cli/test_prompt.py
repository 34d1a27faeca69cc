"""The command `dronecats prompt extract` writes a listing of a LaTeX source as a file for `--prompt`."""

import pytest

from dronecats.agent import prompt as prompts
from dronecats.agent.prompt import Prompt
from dronecats.cli.main import main, parse
from dronecats.flight.run.fly import settings
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated

TEMPLATE = "Fly.\nCommand: {instruction}\n{history}\n"
SOURCE = f"\\begin{{document}}\n\\begin{{lstlisting}}[style=x]\n{TEMPLATE}\\end{{lstlisting}}\n\\end{{document}}\n"


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "paper.tex"
    path.write_text(SOURCE)
    return path


def test_the_extracted_listing_is_a_valid_prompt_file(source, tmp_path, capsys):
    out = tmp_path / "paper.txt"
    assert main(["prompt", "extract", str(source), "--out", str(out)]) == 0
    assert f"--prompt {out}" in capsys.readouterr().out
    assert out.read_text() == TEMPLATE == Prompt.load(out).template
    assert parse(["fly", "--sitl", "--prompt", str(out)]).prompt == out
    assert main(["prompt", "extract", str(source), "--out", str(out)]) == 0  # a repeated command succeeds


def test_unreadable_sources_and_existing_files_are_rejected(source, tmp_path, capsys):
    out = tmp_path / "mine.txt"
    out.write_text("mine")
    for path, words in ((source, "mine.txt"), (tmp_path / "none.tex", "none.tex"), (tmp_path, str(tmp_path))):
        assert main(["prompt", "extract", str(path), "--out", str(out)]) == 2
        error = capsys.readouterr().err
        assert words in error
        assert len(error.splitlines()) == 1
    assert out.read_text() == "mine"


def test_a_run_records_the_name_of_its_prompt(monkeypatch):
    def name(template):
        flight = look_up(FlightSpec(pilot="vision", simulated=Simulated(), prompt=template))
        return settings(flight, flight.camera)["prompt_name"]

    assert (name(None), name(TEMPLATE)) == ("dronecats", "custom")
    monkeypatch.setattr(prompts, "PAPER_SHA256", prompts.template_sha256(TEMPLATE))
    assert (name(TEMPLATE), name(f"{TEMPLATE}\n")) == ("paper", "paper")  # an editor may have added a newline
