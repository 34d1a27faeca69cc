"""The name of the kernel cache depends on every file that a compiled kernel can use."""

import ast
import re

from foundation.compiled import ROOT, sources

ROOMS = ("foundation", "vehicles", "autopilot", "episodes", "dronecats", "hil")


def file_of(module):
    path = ROOT / module.replace(".", "/")
    return next((f for f in (path.with_suffix(".py"), path / "__init__.py") if f.is_file()), None)


def imported(path):
    """Return our files that a file imports at its top level."""
    files = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in ROOMS:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            files |= {file_of(name) for name in names} - {None}
        elif isinstance(node, ast.Import):
            files |= {file_of(alias.name) for alias in node.names if alias.name.split(".")[0] in ROOMS} - {None}
    return files


def test_the_kernel_cache_name_covers_every_file_that_a_kernel_imports():
    kernels = [
        path
        for room in ROOMS
        for path in (ROOT / room).rglob("*.py")
        if re.search(r"^@njit|= njit\(", path.read_text(), re.MULTILINE)
    ]
    assert len(kernels) > 20
    source_files = set(sources())
    assert set(kernels) <= source_files
    named = {(path, other) for path in kernels for other in imported(path) if other not in source_files}
    assert not {(p, o) for p, o in named if o.name != "__init__.py" and "compile_ahead" not in o.name}
