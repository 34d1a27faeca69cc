"""Flies in this process, with the command that a user gives."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import main, parse
from dronecats.flight.run.fly import fly
from tests.support.command_line import last_object


def fly_simulated(capsys, out: Path, *arguments: str) -> tuple[dict[str, Any], Path]:
    """Fly one episode into the run folder `out`; return its result and its folder. The status must be 0."""
    assert main(["fly", "--sitl", "--out", str(out), "--json", *arguments]) == 0
    result = last_object(capsys.readouterr().out)
    return result, out / result["episode"]


def fly_beginning(out: Path, seconds: float, *arguments: str) -> Path:
    """Fly only the first seconds of the flight that these arguments describe; return its folder."""
    spec = replace(spec_of(parse(["fly", "--sitl", "--speed", "max", *arguments])), seconds=seconds, full=True)
    result = fly(spec, out, lambda line: None)
    assert result["status"] == 0, result["error"]
    return out / str(result["episode"])
