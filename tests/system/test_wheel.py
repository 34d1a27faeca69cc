"""The wheel and the sdist contain git's files of the six packages. The installed wheel flies without the checkout.

The build uses the pinned tools of requirements/dev.lock: with `--no-isolation`, pip fetches no others.
It uses a copy of the checkout, because setuptools reuses the file list that an earlier build leaves there.
"""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

from dronecats import __version__

pytestmark = pytest.mark.slow("builds a wheel, installs it and flies it")

ROOT = Path(__file__).parents[2]
ROOMS = {"foundation", "dronecats", "autopilot", "vehicles", "episodes", "hil"}
BESIDE = {"CHANGELOG.md", "LICENSE", "MANIFEST.in", "PKG-INFO", "README.md", "pyproject.toml",
          "requirements/dev.lock", "requirements/fly.lock"}  # fmt: skip
MODELS = "dronecats/agent/models/models.toml"
OURS = (
    "PYTHONPATH",
    "PYTHONHOME",
    "NUMBA_CACHE_DIR",
    "XDG_CACHE_HOME",
    "DRONECATS_MAPS",
    "DRONECATS_MODELS",
    "XDG_CONFIG_HOME",
)


def finished(*words, cwd, **variables):
    """Run a program that must succeed, in an environment without this checkout; return its output."""
    environment = {key: value for key, value in os.environ.items() if key not in OURS} | variables
    done = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{words}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}"
    return done.stdout


def build(kind, source, out):
    """Build a source tree with `python -m build`, and return the built file. `kind` is wheel or sdist."""
    finished(sys.executable, "-m", "build", "--no-isolation", f"--{kind}", "--outdir", out, source, cwd=out)
    (built,) = out.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return built


def in_rooms(names):
    return {name for name in names if name.split("/")[0] in ROOMS}


def contents(wheel):
    """Return {file name: bytes} of a wheel, without its .dist-info folder."""
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if not name.endswith("/") and ".dist-info/" not in name]
        return {name: archive.read(name) for name in names}


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Return a copy of all files that git tracks, or would track after `git add`."""
    copy = tmp_path_factory.mktemp("checkout")
    listed = subprocess.check_output(("git", "ls-files", "-z", "-co", "--exclude-standard"), cwd=ROOT, text=True)
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():  # git also lists files that were just removed
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, copy / name)
    return copy


@pytest.fixture(scope="module")
def tracked(checkout):
    """Return {file name: bytes} of the six packages, read before any build."""
    files = [path for room in sorted(ROOMS) for path in (checkout / room).rglob("*") if path.is_file()]
    return {str(path.relative_to(checkout)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def wheel(checkout, tracked, tmp_path_factory):
    return build("wheel", checkout, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def sdist(checkout, wheel, tmp_path_factory):
    for left in (*checkout.glob("*.egg-info"), checkout / "build"):
        shutil.rmtree(left)
    return build("sdist", checkout, tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Install only the wheel with [sim] in a new environment; return the environment's bin folder."""
    folder = tmp_path_factory.mktemp("environment")
    finished(sys.executable, "-m", "venv", folder, cwd=folder)
    pip = (folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    finished(*pip, "--constraint", ROOT / "requirements" / "fly.lock", f"{wheel}[sim]", cwd=folder)
    return folder / "bin"


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """Return an empty working folder in an otherwise empty home."""
    (home := tmp_path_factory.mktemp("home")).joinpath("work").mkdir()
    return home / "work"


@pytest.fixture
def dronecats(installed, elsewhere):
    return lambda *words: finished(installed / "dronecats", *words, cwd=elsewhere, HOME=str(elsewhere.parent))


def test_the_wheel_contains_exactly_the_package_files(wheel, tracked):
    held = contents(wheel)
    assert set(tracked) - set(held) == set()
    assert set(held) - set(tracked) == set()
    assert held == tracked


def test_every_package_has_a_py_typed_file(wheel):
    assert {f"{room}/py.typed" for room in ROOMS} <= set(contents(wheel))


def test_the_wheel_has_complete_metadata(wheel):
    with zipfile.ZipFile(wheel) as archive:
        metadata = Parser().parsestr(archive.read(f"dronecats-{__version__}.dist-info/METADATA").decode())
        top = archive.read(f"dronecats-{__version__}.dist-info/top_level.txt").decode().split()
    assert (metadata["Name"], metadata["Version"], metadata["License-Expression"]) == (
        "dronecats",
        __version__,
        "Apache-2.0",
    )
    assert metadata["Description-Content-Type"] == "text/markdown"
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(metadata.get_all("Provides-Extra") or ()) == set(extras)
    assert set(top) == ROOMS


def test_the_sdist_contains_the_packages_and_the_build_files(sdist, tracked):
    with tarfile.open(sdist) as archive:
        names = {member.name.split("/", 1)[1] for member in archive.getmembers() if member.isfile()}
    assert in_rooms(names) == set(tracked)
    beside = {name for name in names - in_rooms(names) if ".egg-info/" not in name}
    assert beside == {*BESIDE, "setup.cfg"}


def test_the_sdist_builds_the_same_wheel(sdist, wheel, tmp_path):
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    out = tmp_path / "again"
    out.mkdir()
    assert contents(build("wheel", source, out)) == contents(wheel)


def test_python_imports_the_installed_packages(installed, elsewhere):
    code = f"import {', '.join(sorted(ROOMS))}, sys; print(*(sys.modules[r].__file__ for r in {sorted(ROOMS)}))"
    for file in finished(installed / "python", "-c", code, cwd=elsewhere).split():
        assert Path(file).is_relative_to(installed.parent)


def test_the_installed_program_prints_version_help_and_episodes(dronecats):
    assert dronecats("--version") == f"dronecats {__version__}\n"
    assert "episode" in dronecats("--help")
    records = ROOT / "episodes" / "records"
    for folder, suite in ((records / "v2", "all"), (records / "v1", "v1")):
        listed = json.loads(dronecats("episodes", "list", "--suite", suite, "--json"))["episodes"]
        assert {episode["id"] for episode in listed} == {path.stem for path in folder.glob("*.json")}


def test_the_installed_program_lists_the_shipped_models(dronecats):
    listed = json.loads(dronecats("models", "list", "--json"))["models"]
    assert {row["name"] for row in listed} == set(tomllib.loads((ROOT / MODELS).read_text(encoding="utf-8")))
    assert "base64>" in dronecats("models", "show", "gpt-5")


def test_doctor_finds_a_complete_installation(dronecats, installed):
    report = json.loads(dronecats("doctor", "--json"))
    assert report["can_simulate"]
    where = next(finding["detail"] for finding in report["findings"] if finding["name"] == "dronecats")
    assert Path(where.removeprefix(f"{__version__} in ")).is_relative_to(installed.parent)


def test_the_installed_program_flies_and_does_not_change_its_environment(dronecats, installed, elsewhere):
    before = sorted(installed.parent.rglob("*"))
    result = json.loads(dronecats("fly", "--sitl", "--speed", "max", "--json").splitlines()[-1])
    assert result["success"] is True
    folder = elsewhere / result["run_dir"]
    assert json.loads((folder.parent / "run.json").read_text())["versions"]["dronecats"] == __version__
    assert json.loads((folder / "verdict.json").read_text())["success"] is True
    dronecats("judge", str(folder.parent))
    assert sorted(installed.parent.rglob("*")) == before
