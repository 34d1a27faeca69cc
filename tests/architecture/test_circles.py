"""There are no import cycles, imports in functions included, and `ROOMS` lists every package of the product."""

import re
from functools import cache
from importlib.util import find_spec

import pytest

from tests.architecture.import_graph import ROOMS, ROOT, circles, graph, modules

BESIDE = {"tests", "benchmarks", "examples", "docs"}  # top-level packages that no room (package of the product) imports


@cache
def edges() -> dict[str, set[str]]:
    """Return module → the modules that it imports or names, for all of our modules."""
    return graph(modules())


def test_there_are_no_import_cycles():
    assert circles(edges()) == []


@pytest.mark.parametrize(
    "line",
    [
        "from foundation import second",
        "def f():\n    import foundation.second",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from foundation.second import thing",
        'CHILD = "foundation.second"',
    ],
    ids=["at the top", "late", "for a type checker", "by its name"],
)
def test_every_kind_of_import_cycle_is_detected(line, tmp_path):
    (tmp_path / "foundation").mkdir()
    for name, text in (("__init__", ""), ("first", line), ("second", "import foundation.first")):
        (tmp_path / "foundation" / f"{name}.py").write_text(text)
    cycles = circles(graph(modules(tmp_path, ("foundation",))))
    assert cycles == [["foundation.first", "foundation.second"]]


def test_no_package_imports_tests_or_benchmarks_and_every_package_is_listed():
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    assert packages - BESIDE == set(ROOMS)
    for path in modules().values():
        text = path.read_text(encoding="utf-8")
        assert not re.search(rf"^\s*(from|import) ({'|'.join(BESIDE)})\b", text, re.MULTILINE), path


def test_child_process_modules_named_in_strings_can_be_imported():
    named = {name for needed in edges().values() for name in needed if name.endswith(("_process", ".worker"))}
    assert {"dronecats.flight.sitl.simulator_process", "dronecats.bench.worker"} <= named
    assert all(find_spec(name) for name in named)


def test_only_one_module_uses_the_wire_format_classes():
    """Callers give a `ModelSpec` to `open_model`. No other module uses the classes of the wire formats."""
    formats = ("ChatModel", "GeminiModel", "AnthropicModel")
    users = {name for name, path in modules().items() if any(f in path.read_text(encoding="utf-8") for f in formats)}
    assert users == {"dronecats.agent.models.wire_formats"}


def test_only_the_cli_and_the_fitting_tool_import_argparse():
    """The fits of the vision pilot are not part of the CLI. Developers run them from a clone."""
    reading = {name for name, path in modules().items() if "import argparse" in path.read_text(encoding="utf-8")}
    assert {name for name in reading if not name.startswith("dronecats.cli.")} == {"dronecats.pilots.fitting.__main__"}
