"""Verb `doctor`: checks what works on this machine, what is missing, and how to install it."""

import argparse
import importlib
import json
import os
import platform
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path

from dronecats import __version__
from dronecats.agent.models import rows
from dronecats.agent.models.spec import LOOPBACK, PROVIDERS
from dronecats.cli.next_commands import print_next
from dronecats.cli.output import show
from dronecats.report.table import ReportTable, table_of, words
from foundation import machine
from foundation.errors import UsageError
from foundation.extras import BASE_COMMAND, EXTRAS, Extra, is_installed
from foundation.machine import cores, port_holder

OK, NOTE, MISSING = "ok", "note", "missing"
_MARKS = {OK: "✓", NOTE: "·", MISSING: "✗"}
PACKAGE, EXTRA, MACHINE = "package", "extra", "machine"
_HEADINGS = {PACKAGE: "Packages", EXTRA: "Extras", MACHINE: "This machine"}

# distribution → name of its module
BASE = {
    "mavsdk": "mavsdk",
    "pymavlink": "pymavlink",
    "numpy": "numpy",
    "scipy": "scipy",
    "control": "control",
    "filterpy": "filterpy",
    "opencv-python-headless": "cv2",
    "httpx": "httpx",
    "msgspec": "msgspec",
}
REINSTALL = 'pip install --force-reinstall "dronecats[sim]"'
SIM = "sim"  # the extra that simulated flights require
PYTHON = (3, 11)
PORTS = {
    14540: "offboard MAVLink, where an agent listens",
    14550: "ground station MAVLink, where QGroundControl listens",
}
KEYS = {provider.key_variable: provider.name for provider in PROVIDERS.values() if provider.key_variable}
HOSTED = [
    variable for variable, name in KEYS.items() if not (PROVIDERS[name].base_url or LOOPBACK).startswith(LOOPBACK)
]
DISK_WANTED_GB = 1.0  # a run stores about 120 frames of 40 kB per episode; compiled code also needs space


@dataclass(frozen=True, slots=True)
class Diagnosis:
    name: str
    state: str  # OK; NOTE: a problem that does not prevent simulated flights; MISSING: a problem that does
    detail: str
    remedy: str = ""
    kind: str = MACHINE  # PACKAGE, EXTRA or MACHINE


def add_doctor_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the findings. Return 0 if this machine can simulate flights, else 1."""
    findings = examine()
    able = all(f.state != MISSING for f in findings)
    if args.json:
        print(json.dumps({"can_simulate": able, "findings": [asdict(f) for f in findings]}))
        return 0 if able else 1
    sections = ((heading, [f for f in findings if f.kind == kind]) for kind, heading in _HEADINGS.items())
    show(*(_table(heading, section) for heading, section in sections if section))
    print(f"\nFlying in simulation is {'possible here.' if able else 'NOT possible here yet: see ✗.'}")
    if able:
        print_next("doctor")
    return 0 if able else 1


def _table(heading: str, findings: list[Diagnosis]) -> ReportTable:
    """Return one section as a table. The remedy of an extra has its own column; other remedies are on the next line."""
    columns = [words("")] * (4 if findings[0].kind == EXTRA else 3)
    lines = []
    for finding in findings:
        beside = finding.kind == EXTRA
        below = f"\n→ {finding.remedy}" if finding.remedy and not beside else ""
        line = (_MARKS[finding.state], finding.name, f"{finding.detail}{below}")
        lines.append((*line, finding.remedy) if beside else line)
    return replace(table_of(columns, lines), title=f"{heading}:")


def examine() -> list[Diagnosis]:
    """Return all findings, in the order of the output. Never raises: an exception in a check becomes a finding."""
    findings = [_version(), _python()]
    if (short := _memory()).state == MISSING:  # without memory, the following imports would crash
        return [*findings, short]
    findings += [*(_package(*names) for names in BASE.items()), *map(_extra, EXTRAS), short]
    checks: list[Callable[[], Diagnosis]] = [_jpeg]
    if all(finding.state != MISSING for finding in findings):
        checks += [_compiler, _rays]
    checks += [partial(port, p, w) for p, w in PORTS.items()]
    checks += [_disk, _cores, _models, _keys]
    for check in checks:
        try:
            findings.append(check())
        except Exception as error:  # a damaged installation can raise anything
            name = getattr(check, "__name__", "check").strip("_")
            findings.append(Diagnosis(name, MISSING, f"{type(error).__name__}: {error}", REINSTALL))
    return findings


def _version() -> Diagnosis:
    return Diagnosis("dronecats", OK, f"{__version__} in {Path(__file__).resolve().parents[2]}", kind=PACKAGE)


def _python() -> Diagnosis:
    detail = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    if sys.version_info < PYTHON:
        return Diagnosis("python", MISSING, detail, f"Python {PYTHON[0]}.{PYTHON[1]} or newer is needed", PACKAGE)
    return Diagnosis("python", OK, detail, kind=PACKAGE)


def _memory() -> Diagnosis:
    from dronecats.cli.main import FLIGHT_GB

    limit = machine.limit_gb()
    try:
        machine.check("a flight", FLIGHT_GB)
    except UsageError as error:
        return Diagnosis("memory", MISSING, str(error), "raise the limit of this shell: ulimit -v")
    return Diagnosis("memory", OK, "address space is not limited" if limit is None else f"limited to {limit:.1f} GB")


def _package(distribution: str, module: str) -> Diagnosis:
    try:
        version = metadata.version(distribution)
    except metadata.PackageNotFoundError:
        version = ""
    if fault := _import_fault(module):
        remedy = _reinstall(distribution) if version else BASE_COMMAND
        return Diagnosis(distribution, MISSING, fault, remedy, PACKAGE)
    return Diagnosis(distribution, OK, version or "installed without metadata", kind=PACKAGE)


def _extra(extra: Extra) -> Diagnosis:
    """Return whether an extra is installed. Only the packages of SIM are imported, because the others import slowly."""
    if not all(map(is_installed, extra.modules)):
        return Diagnosis(extra.name, MISSING if extra.name == SIM else NOTE, extra.enables, extra.command, EXTRA)
    if extra.name == SIM and (faults := [*filter(None, map(_import_fault, extra.modules))]):
        return Diagnosis(extra.name, MISSING, faults[0], REINSTALL, EXTRA)
    return Diagnosis(extra.name, OK, extra.enables, kind=EXTRA)


def _reinstall(packages: str) -> str:
    return f"pip install --force-reinstall {packages}"


def _import_fault(module: str) -> str:
    """Return the reason why a module cannot be imported; empty if it can."""
    if not is_installed(module):
        return "not installed"
    try:
        importlib.import_module(module)
    except Exception as error:  # a damaged binary can raise anything
        return f"{module} does not import: {error}"
    return ""


def _jpeg() -> Diagnosis:
    import cv2
    import numpy as np

    picture = np.zeros((16, 16, 3), np.uint8)
    done, data = cv2.imencode(".jpg", picture)
    again = cv2.imdecode(data, cv2.IMREAD_COLOR) if done else None
    if again is None or again.shape != picture.shape:
        return Diagnosis("JPEG", MISSING, "OpenCV cannot write and read JPEG", _reinstall("opencv-python-headless"))
    return Diagnosis("JPEG", OK, "OpenCV writes and reads it")


def _compiler() -> Diagnosis:
    """Compile one function, and check whether compiled code is stored for the next start."""
    import numba

    from foundation import compiled

    started = time.perf_counter()
    if numba.njit(lambda x: 2.0 * x + 1.0)(3.0) != 7.0:
        return Diagnosis("compiler", MISSING, "numba compiles wrongly", _reinstall("numba llvmlite"))
    detail = f"numba compiles ({time.perf_counter() - started:.1f} s for one function)"
    if compiled.CAN_CACHE:
        return Diagnosis("compiler", OK, f"{detail} and stores its results")
    try:
        kept = f"{compiled.cache_folder().parent} cannot be written to"
    except UsageError as homeless:
        kept = str(homeless)
    kept += ", so every start compiles for a minute"
    return Diagnosis("compiler", NOTE, f"{detail}; {kept}", "set NUMBA_CACHE_DIR to a writable folder")


def _rays() -> Diagnosis:
    """Check that Embree finds the hit of one ray with one triangle."""
    import numpy as np
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.array([[[-1, -1, 1], [1, -1, 1], [0, 1, 1]]], np.float32))
    hit = scene.run(np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32))
    if list(hit) != [0]:
        return Diagnosis("rays", MISSING, "Embree does not find a triangle in front of the ray", _reinstall("embreex"))
    return Diagnosis("rays", OK, "Embree finds a triangle in front of the ray")


def port(number: int, purpose: str) -> Diagnosis:
    """Return whether a UDP port on the loopback address is free, and which program uses it if it is not.

    A used port does not prevent a simulated flight, which uses any free port.
    """
    name = f"UDP {number}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", number))
        except OSError:
            by = port_holder("UDP", number) or "another program"
            return Diagnosis(name, NOTE, f"taken by {by} ({purpose})", "stop that program, or give another port")
    return Diagnosis(name, OK, f"free ({purpose})")


def _disk() -> Diagnosis:
    here = Path.cwd()
    free = shutil.disk_usage(here).free / 1e9
    detail = f"{free:.1f} GB free for runs"
    if not os.access(here, os.W_OK):
        remedy = f"fly with --out below {tempfile.gettempdir()}"
        return Diagnosis("disk", NOTE, "this folder cannot be written to", remedy)
    if free < DISK_WANTED_GB:
        remedy = f"make room for {DISK_WANTED_GB:g} GB, or fly with --out on another disk"
        return Diagnosis("disk", NOTE, detail, remedy)
    return Diagnosis("disk", OK, detail)


def _cores() -> Diagnosis:
    if cores() < 2:
        return Diagnosis("cores", NOTE, f"{cores()}", "real time needs two; lockstep flights only take longer")
    return Diagnosis("cores", OK, f"{cores()}")


def _models() -> Diagnosis:
    """Return the number of models known by name, and whether the user's own models file can be read."""
    try:
        models = rows.rows()
    except UsageError as error:
        return Diagnosis("models", NOTE, str(error), "correct it: no model can fly until then; docs/models.md")
    own = [row.name for row in models.values() if row.file != rows.SHIPPED]
    return Diagnosis("models", OK, f"{len(models)} by name" + (f", {len(own)} of {rows.own_file()}" if own else ""))


def _keys() -> Diagnosis:
    """Return which model keys are set. The finding does not contain their values."""
    present = [f"{name} ({provider})" for name, provider in KEYS.items() if os.environ.get(name)]
    if present:
        return Diagnosis("model keys", OK, "set: " + ", ".join(present))
    detail = "none set: hosted models need one, local models and the built-in pilots do not"
    return Diagnosis("model keys", NOTE, detail, f"set {', '.join(HOSTED[:-1])} or {HOSTED[-1]}")
