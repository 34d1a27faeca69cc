"""Whole flights in this process, by the command that a user types."""

from pathlib import Path
from typing import Any

from dronecats.cli.main import main
from tests.support.command_line import last_object


def fly_simulated(capsys, out: Path, *arguments: str) -> tuple[dict[str, Any], Path]:
    """Fly one episode into the run folder `out`, which must end with status 0; return its result and its folder."""
    assert main(["fly", "--sitl", "--out", str(out), "--json", *arguments]) == 0
    result = last_object(capsys.readouterr().out)
    return result, out / result["episode"]
