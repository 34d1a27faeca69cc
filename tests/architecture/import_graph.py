"""Which file imports which, whenever it does: at the top, in a function, or for a type checker only.

A module that is named in a string, as a child process is, counts as imported by the file that names it.
"""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("dronecats", "autopilot", "vehicles", "episodes", "hil", "foundation")


def modules(root: Path = ROOT, rooms: tuple[str, ...] = ROOMS) -> dict[str, Path]:
    """Return module → file of every module of the rooms."""
    found = {}
    for room in rooms:
        for path in sorted((root / room).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def graph(known: dict[str, Path]) -> dict[str, set[str]]:
    """Return module → the modules that its file imports or names."""
    return {name: _imported(path, known) - {name} for name, path in known.items()}


def _imported(path: Path, known: dict[str, Path]) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found.update(inner & known.keys() or {node.module})
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and "." in node.value:
            found.add(node.value)
    return found & known.keys()


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of modules that reach one another, sorted. (Tarjan's strongly connected components.)"""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

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
                found.append(sorted(circle))

    for name in edges:
        if name not in index:
            visit(name)
    return sorted(found)
