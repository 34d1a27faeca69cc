"""Writes the reference of the public modules (MODULES): one page for each module, from its docstrings."""

from collections.abc import Iterator
from importlib import import_module
from itertools import groupby

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
