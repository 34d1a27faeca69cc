"""Every public class or type alias of our packages has a unique name."""

import ast
from collections import defaultdict
from pathlib import Path

from tests.architecture.import_graph import modules

# name → the reason why two types may have it
EXCEPTIONS: dict[str, str] = {}


def meanings(files: dict[str, Path]) -> dict[str, dict[str, list[str]]]:
    """Return name → meaning → its modules. A class is one meaning; an alias means its type."""
    by_name: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for module, path in files.items():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                name, meaning = node.name, f"class of {module}"
            elif (alias := _alias(node)) is not None:
                name, meaning = alias
            else:
                continue
            if not name.startswith("_"):
                by_name[name][meaning].append(module)
    return by_name


def _alias(node: ast.stmt) -> tuple[str, str] | None:
    """Return name and meaning of a type that an assignment names; None for type variables."""
    if isinstance(node, ast.Assign) and len(node.targets) == 1:
        target, value = node.targets[0], node.value
    elif isinstance(node, ast.AnnAssign) and ast.unparse(node.annotation) == "TypeAlias" and node.value is not None:
        target, value = node.target, node.value
    else:
        return None
    if not isinstance(target, ast.Name) or not _camel(target.id):
        return None
    if isinstance(value, ast.Call) and ast.unparse(value.func) in ("TypeVar", "ParamSpec"):
        return None
    return target.id, ast.unparse(value)


def _camel(name: str) -> bool:
    return name[0].isupper() and any(letter.islower() for letter in name)


def test_no_two_public_types_share_a_name():
    shared = {name: dict(each) for name, each in meanings(modules()).items() if len(each) > 1}
    assert {name: each for name, each in shared.items() if name not in EXCEPTIONS} == {}
    assert shared.keys() >= EXCEPTIONS.keys(), "an exception that excepts nothing"


def test_two_types_with_one_name_are_detected(tmp_path):
    (tmp_path / "a.py").write_text("class Stage: ...\nPoint = tuple[float, float]\nPoints = list[Point]\n")
    (tmp_path / "b.py").write_text("class Stage: ...\nPoint = tuple[float, float, float]\nPoints = list[Point]\n")
    files = {"a": tmp_path / "a.py", "b": tmp_path / "b.py"}
    assert {name for name, each in meanings(files).items() if len(each) > 1} == {"Stage", "Point"}
