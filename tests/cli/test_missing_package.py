"""If a package is missing, a command ends with status 2 and the command that installs it. It writes nothing."""

import re
import sys
import tomllib
from functools import cache
from importlib import metadata
from importlib.abc import MetaPathFinder
from pathlib import Path

import pytest

from dronecats.cli.exit_status import exit_status
from foundation.errors import InfrastructureError, UsageError
from foundation.extras import EXTRAS, OWN_PACKAGES, extra_of, missing_package
from tests.support.run_folders import run_folder

ROOT = Path(__file__).parents[2]
EPISODE, INSCRIPTION = "residential-approaching-01", "residential-commanding-01"
SERIAL = "serial:///dev/ttyACM0:57600"
COMMANDS = (
    ("sim", ["fly", "--sitl", "--speed", "max"]),
    ("sim", ["bench", EPISODE, "--pilot", "oracle", "--out", "out"]),
    ("sim", ["sitl"]),
    ("sim", ["episodes", "check", EPISODE]),
    ("sim", ["film", "made", "--out", "film.mp4"]),
    ("vision", ["fly", "--sitl", "--speed", "max", "--pilot", "vision", "--episode", INSCRIPTION]),
    ("vision", ["bench", INSCRIPTION, "--pilot", "vision", "--out", "out"]),
    ("view", ["edit", "--no-browser"]),
    ("view", ["replay", "made", "--no-browser"]),
    ("view", ["fly", "--sitl", "--view"]),
    ("view", ["bench", EPISODE, "--pilot", "oracle", "--out", "out", "--view"]),
    ("query", ["query", "SELECT * FROM runs", "made"]),
    ("query", ["export", "made", "--to", "csv", "--out", "out"]),
    ("query", ["export", "made", "--to", "parquet", "--out", "out"]),
    ("query", ["bench", "export-parquet", "made", "--out", "out"]),
    ("export", ["export", "made", "--to", "mcap", "--out", "out"]),
    ("rerun", ["export", "made", "--to", "rerun", "--out", "out"]),
    ("lerobot", ["export", "made", "--to", "lerobot", "--out", "out"]),
    ("ulog", ["flightlog", "trace", "made", "--ulog", "flight.ulg"]),
    ("serial", ["fly", "--connect", SERIAL, "--camera", "http://127.0.0.1:1", "--instruction", "go"]),
    ("serial", ["preflight", "--connect", SERIAL]),
    ("cluster", ["bench", EPISODE, "--pilot", "oracle", "--engine", "ray", "--out", "out"]),
)


def normalized(distribution):
    return re.sub(r"[-_.]+", "-", distribution).lower()


def declared():
    """Map each extra to the names of its distributions, without `dronecats[…]` itself."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = {
        extra: [re.split(r"[^\w.-]", requirement)[0] for requirement in requirements]
        for extra, requirements in extras.items()
    }
    return {
        extra: {normalized(name) for name in distributions if name != "dronecats"}
        for extra, distributions in names.items()
    }


@cache
def installed_modules():
    """Map each distribution to its top-level modules."""
    modules: dict[str, set[str]] = {}
    for module, distributions in metadata.packages_distributions().items():
        for name in distributions:
            modules.setdefault(normalized(name), set()).add(module)
    return modules


@pytest.fixture
def absent(monkeypatch):
    """Return a function that hides packages from later imports."""
    names: set[str] = set()

    class Absent(MetaPathFinder):
        def find_spec(self, name, path=None, target=None):
            if name.split(".")[0] in names:
                raise ModuleNotFoundError(f"No module named '{name}'", name=name)

    def hide(modules):
        names.update(modules)
        for name in [name for name in sys.modules if name.split(".")[0] in {*modules, *OWN_PACKAGES}]:
            monkeypatch.delitem(sys.modules, name)

    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    before = {name: module for name, module in sys.modules.items() if name.split(".")[0] in OWN_PACKAGES}
    yield hide
    for name in [name for name in sys.modules if name.split(".")[0] in OWN_PACKAGES]:
        del sys.modules[name]
    sys.modules.update(before)


@pytest.mark.parametrize(("extra", "words"), COMMANDS, ids=[" ".join(words) for _, words in COMMANDS])
def test_a_command_names_the_extra_that_it_needs_and_does_nothing(extra, words, absent, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    run_folder(tmp_path / "made", {EPISODE: "find it"})
    before = sorted(tmp_path.rglob("*"))
    absent(next(candidate.modules for candidate in EXTRAS if candidate.name == extra))
    from dronecats.cli.main import main

    assert main(words) == 2
    error = capsys.readouterr().err
    assert f"dronecats[{extra}]" in error
    assert len(error.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("module", ["viser", "pyarrow.parquet", "google.genai.types"])
def test_a_module_belongs_to_the_extra_that_adds_its_package(module):
    extra = extra_of(module)
    assert extra is not None
    assert extra.command in (missing_package(ModuleNotFoundError(module, name=module)) or "")


@pytest.mark.parametrize("module", ["google.protobuf", "cv2", "rerunning"])
def test_a_module_of_a_foreign_package_belongs_to_no_extra(module):
    assert extra_of(module) is None
    assert "dronecats[" not in (missing_package(ModuleNotFoundError(module, name=module)) or "")


def test_extras_match_pyproject():
    assert {extra.name for extra in EXTRAS} == declared().keys() - {"all"}


def test_all_installs_every_extra_of_the_commands():
    everything = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["all"]
    names = re.findall(r"[\w-]+", re.findall(r"\[(.*)\]", everything[0])[0])
    assert set(names) == {extra.name for extra in EXTRAS} - {"train", "docs", "dev"}


@pytest.mark.parametrize("extra", EXTRAS, ids=lambda extra: extra.name)
def test_modules_of_an_extra_match_its_distributions(extra):
    """Only installed distributions are compared."""
    distributions = declared()[extra.name]
    brought = installed_modules()
    tops = {module.split(".")[0] for module in extra.modules}
    installed = distributions & brought.keys()
    assert {name for name in installed if not brought[name] & tops} == set()
    of_none = tops - set().union(*(brought[name] for name in installed))
    assert len(of_none) <= len(distributions - installed)


@pytest.mark.parametrize(
    "error", [ImportError("libGL.so.1: cannot open", name="cv2"), ImportError("half a package")], ids=["named", "not"]
)
def test_a_damaged_package_exits_with_2_and_prints_its_error(error, capsys):
    def load():
        raise error

    assert exit_status("program", load) == 2
    assert str(error) in capsys.readouterr().err


@pytest.mark.parametrize("name", ["hil.lnik", "foundation.eror"])
def test_a_missing_module_of_this_project_keeps_its_traceback(name):
    def load():
        raise ModuleNotFoundError(f"No module named '{name}'", name=name)

    with pytest.raises(ModuleNotFoundError, match=name):
        exit_status("program", load)


@pytest.mark.parametrize(
    ("error", "status"), [(UsageError("no"), 2), (InfrastructureError("no"), 3), (KeyboardInterrupt(), 130)]
)
def test_an_error_prints_one_line_and_sets_the_exit_status(error, status, capsys):
    def work():
        raise error

    assert exit_status("program", work) == status
    assert len(capsys.readouterr().err.splitlines()) == 1
