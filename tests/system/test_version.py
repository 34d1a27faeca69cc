"""Every place that states the version states `dronecats.__version__`."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from dronecats import __version__
from dronecats.cli import doctor
from dronecats.cli.main import main
from foundation.run_folder.folder import write_run

ROOT = Path(__file__).parents[2]


def test_the_project_takes_its_version_from_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" in project["project"]["dynamic"]
    assert "version" not in project["project"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "foundation.version.__version__"}


def test_the_version_option_prints_the_version(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"dronecats {__version__}\n"


def test_doctor_reports_the_version_and_the_package_folder():
    version_finding = next(finding for finding in doctor.examine() if finding.name == "dronecats")
    assert version_finding.detail == f"{__version__} in {ROOT}"


def test_run_json_records_the_version(tmp_path):
    write_run(tmp_path, {})
    assert json.loads((tmp_path / "run.json").read_text())["versions"]["dronecats"] == __version__


@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        pytest.param("CHANGELOG.md", r"^## \[(\d\S*)\] - \d{4}-\d\d-\d\d$", id="newest release in the changelog"),
        pytest.param("CITATION.cff", r"^version: (\S+)$", id="citation"),
    ],
)
def test_changelog_and_citation_have_the_version(name: str, pattern: str):
    first = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    assert first, f"{name} has no line like {pattern}"
    assert first[1] == __version__
