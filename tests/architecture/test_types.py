"""mypy checks every package."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
CHECKER = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
OF_LIBRARIES = {"module", "ignore_missing_imports", "follow_imports"}  # permissions for libraries without types


def test_every_package_is_checked():
    assert CHECKER["strict"]
    assert sorted(CHECKER["packages"]) == sorted(folder.parent.name for folder in ROOT.glob("*/__init__.py"))


def test_only_the_tests_have_relaxed_type_checks():
    ours = {*CHECKER["packages"]}
    for override in CHECKER["overrides"]:
        rooms = {module.split(".")[0] for module in override["module"]} & ours
        assert rooms <= {"tests"}
        assert rooms or set(override) <= OF_LIBRARIES
        assert not override.get("ignore_errors", False)
        assert not rooms or override["check_untyped_defs"]
