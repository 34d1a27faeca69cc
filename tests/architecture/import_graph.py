"""The import graph of the modules: imports at the top, in a function, or for a type checker only.

A module that a file names in a string, for example as a child process, counts as imported.
"""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("dronecats", "autopilot", "vehicles", "episodes", "hil", "foundation")


def modules(root: Path = ROOT, rooms: tuple[str, ...] = ROOMS) -> dict[str, Path]:
    """Return module → file of every module of the rooms (top-level packages)."""
    paths = {}
    for room in rooms:
        for path in sorted((root / room).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return paths


def graph(modules_by_name: dict[str, Path]) -> dict[str, set[str]]:
    """Return module → the modules that its file imports or names."""
    return {name: _imported(path, modules_by_name) - {name} for name, path in modules_by_name.items()}


def _imported(path: Path, modules_by_name: dict[str, Path]) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            names.update(inner & modules_by_name.keys() or {node.module})
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and "." in node.value:
            names.add(node.value.partition(":")[0])
    return names & modules_by_name.keys()


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of modules that import one another, sorted (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    cycles: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in edges[name]:
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            circle: list[str] = []
            while not circle or circle[-1] != name:
                circle.append(stack.pop())
            if len(circle) > 1:
                cycles.append(sorted(circle))

    for name in edges:
        if name not in index:
            visit(name)
    return sorted(cycles)
