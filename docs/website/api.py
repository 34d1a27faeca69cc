"""Writes the reference of the public modules (MODULES): one page for each module, from its docstrings.

`process` and `document_comments` convert docstrings and comments into a form that Sphinx can read.
"""

import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from itertools import groupby
from typing import Any

from sphinx.pycode import ModuleAnalyzer

# The modules that programs outside the project may import. Other modules may change without a note in CHANGELOG.md.
MODULES = (
    "foundation.airframe",
    "foundation.camera",
    "foundation.errors",
    "foundation.frames",
    "foundation.measurement",
    "foundation.protocol",
    "foundation.run_folder.layout",
    "foundation.run_folder.reading",
    "foundation.run_folder.results",
    "foundation.run_folder.rows",
    "foundation.run_folder.schema",
    "foundation.run_folder.writing",
    "foundation.sensors",
    "foundation.setpoints",
    "foundation.terrain",
    "vehicles.airframe",
    "vehicles.faults",
    "vehicles.fault_script",
    "vehicles.multirotor",
    "vehicles.sensors",
    "autopilot.autopilot",
    "autopilot.control.loop_design",
    "autopilot.estimator.estimated_state",
    "autopilot.parameters",
    "autopilot.replay",
    "episodes.authoring.check.finding",
    "episodes.authoring.check.rules",
    "episodes.authoring.propose.proposals",
    "episodes.authoring.scene_pictures",
    "episodes.camera.optics.camera",
    "episodes.camera.renderer.renderer",
    "episodes.maps",
    "episodes.maps.scene",
    "episodes.records.catalogue",
    "episodes.records.record",
    "episodes.world.world",
    "hil.cameras.lens",
    "hil.cameras.open",
    "hil.impairment",
    "hil.link.conversation",
    "hil.link.envelope",
    "hil.link.link",
    "hil.link.telemetry",
    "hil.preflight.check",
    "hil.simulator",
    "dronecats.agent.action",
    "dronecats.agent.cockpit",
    "dronecats.agent.controller",
    "dronecats.agent.latency",
    "dronecats.agent.loop",
    "dronecats.agent.models.model",
    "dronecats.agent.models.spec",
    "dronecats.agent.prompt",
    "dronecats.bench.campaign",
    "dronecats.bench.engine",
    "dronecats.bench.harnesses.gymnasium_env",
    "dronecats.bench.harnesses.inspect_task",
    "dronecats.bench.harnesses.robots",
    "dronecats.flight.run.fly",
    "dronecats.flight.spec.disturbances",
    "dronecats.flight.spec.flight_spec",
    "dronecats.judge.diagnostics",
    "dronecats.judge.judged_flight",
    "dronecats.judge.metrics.metric",
    "dronecats.judge.verdict",
    "dronecats.pilots.actions",
    "dronecats.pilots.server",
    "dronecats.report.recorded.flight",
    "dronecats.report.recorded.run",
    "dronecats.report.recorded.tracks",
    "dronecats.report.results.collection",
    "dronecats.report.results.database",
    "dronecats.report.table",
    "dronecats.study.design",
    "dronecats.study.factors",
    "dronecats.study.plan",
)


def part() -> dict[str, Iterator[str]]:
    """Return the lines of each page, by page name."""
    return {"index": _first_page(), **{module: _module_page(module) for module in MODULES}}


def _first_page() -> Iterator[str]:
    """Yield the lines of the page with all modules."""
    yield from ("# Python API", "", "The modules that your own programs may import.", "")
    yield "[Architecture](../docs/architecture.md) explains the packages."
    for package, modules in groupby(MODULES, lambda module: module.partition(".")[0]):
        yield from ("", f"## {package}", "")
        yield from (f"- [`{module}`]({module}.md): {_summary(module)}" for module in modules)
    yield from ("", "```{toctree}", ":hidden:", "", *MODULES, "```", "")


def _summary(module: str) -> str:
    """Return the first paragraph of a module's docstring."""
    return " ".join((import_module(module).__doc__ or "").partition("\n\n")[0].split())


def _module_page(module: str) -> Iterator[str]:
    yield from (f"# {module}", "", "```{eval-rst}", f".. automodule:: {module}", "```", "")


# Matches `name: type = value  # the meaning`, unless the value contains a #
COMMENTED = re.compile(r"^(\s*\w+(?::| =)[^#\n]*)  # (?!type:|noqa)", re.MULTILINE)
INDENT = "    "
# group 1: code; group 2: a character that only reStructuredText reads as markup
MARKUP = re.compile(r"(`+[^`]*`+)|([*|]|(?<=\w)_(?!\w))")


def document_comments() -> None:
    """Turn the comments beside fields and constants into `#:` comments, which Sphinx reads as documentation."""
    for name in MODULES:
        source = COMMENTED.sub(r"\1  #: ", inspect.getsource(import_module(name)))
        ModuleAnalyzer.cache["module", name] = ModuleAnalyzer.for_string(source, name)


def process(_app: Any, what: str, name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    """Change the lines of a docstring in place: keep its tables, and list a module's members below its text."""
    lines[:] = preformatted(lines)
    if what == "module":
        lines += ["", ".. autosummary::", "   :nosignatures:", "", *(f"   {member}" for member in members(name)), ""]


def preformatted(lines: list[str]) -> list[str]:
    """Return a docstring as reStructuredText. Its indented blocks keep their lines, because they are tables."""
    text: list[str] = []
    inside = False
    for line in lines:
        indented = line.startswith(INDENT) or (inside and not line)
        if indented and not inside:
            text += ["", "::", ""]
        elif inside and not indented:
            text.append("")
        text.append(line if indented else MARKUP.sub(lambda found: found[1] or f"\\{found[2]}", line))
        inside = indented
    return text


def members(module: str) -> list[str]:
    """Return the names of the public classes and functions of a module."""
    defined = vars(import_module(module)).items()
    return [
        name
        for name, value in defined
        if not name.startswith("_") and callable(value) and getattr(value, "__module__", "") == module
    ]
