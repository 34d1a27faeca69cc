"""`dronecats flightlog` copies logs from an autopilot byte for byte, through MAVSDK."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.stages.stage import SIMULATOR
from foundation.errors import UsageError
from foundation.mavlink import dialect
from hil.link.flight_logs import log_store
from hil.link.link import Link
from hil.link.transport import connect
from tests.hil.link import listening


@pytest.fixture(scope="module")
def autopilot(tmp_path_factory: pytest.TempPathFactory):
    """Yield the port of a simulated vehicle, and its log folder on board, which holds two logs."""
    folder = tmp_path_factory.mktemp("vehicle")
    supervisor = Supervisor(folder)
    config = SimulatorConfig(episode="residential-approaching-01", speed=4.0, state_dir=str(folder))
    port = supervisor.start(SIMULATOR, config).ready()["agent"][0]
    link = Link(connect(f"udpout://127.0.0.1:{port}"))
    link.connect()
    link.wait_for(lambda state: state.healthy, 90.0, "becoming ready to arm")
    for seconds in (1.0, 3.0):
        link.arm()
        link.wait(seconds)
        link.order("disarming", dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        link.wait(1.0)
    link.close()
    yield port, folder / "vehicle-1" / "log"
    supervisor.close()


def command(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "dronecats.cli.main", "flightlog", *arguments],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


@pytest.mark.slow
def test_fetch_copies_the_newest_log_byte_for_byte(autopilot, tmp_path: Path) -> None:
    port, on_board = autopilot
    url = f"udpout://127.0.0.1:{port}"
    listed = command("list", "--connect", url, "--json")
    assert listed.returncode == 0, listed.stderr
    logs = json.loads(listed.stdout)["logs"]
    assert [log["size_bytes"] for log in logs] == [path.stat().st_size for path in sorted(on_board.glob("*.ulg"))]
    fetched = command("fetch", "--connect", url, "--out", str(tmp_path / "logs"), "--json")
    assert fetched.returncode == 0, fetched.stderr
    file = Path(json.loads(fetched.stdout)["file"])
    assert file.read_bytes() == (on_board / "log002.ulg").read_bytes()
    assert [path.name for path in (tmp_path / "logs").iterdir()] == [file.name]
    again = command("fetch", "--connect", url, "--out", str(tmp_path / "logs"))
    assert again.returncode == 2
    assert file.name in again.stderr


@pytest.mark.slow
def test_a_chosen_log_is_fetched_and_an_unknown_number_is_rejected(autopilot, tmp_path: Path) -> None:
    port, on_board = autopilot
    with log_store(f"udpout://127.0.0.1:{port}") as store:
        first = store.entries()[0]
        shares: list[float] = []
        file = store.fetch(first, tmp_path, shares.append)
        assert file.read_bytes() == (on_board / "log001.ulg").read_bytes()
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
    refused = command("fetch", "--connect", f"udpout://127.0.0.1:{port}", "--log", "77")
    assert refused.returncode == 2
    assert re.search(r"\b77\b.*\b0, 1\b", refused.stderr)


def test_an_absent_vehicle_and_a_missing_link_have_different_errors() -> None:
    with pytest.raises(UsageError, match="mailto:somebody"), log_store("mailto:somebody"):
        pass
    silent = listening.udp()
    nobody = subprocess.run(
        [
            sys.executable, "-c",
            "import sys; from hil.link.flight_logs import log_store; log_store(sys.argv[1], 1.0).__enter__()",
            f"udpout://127.0.0.1:{silent.port}",
        ],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert "LinkError" in nobody.stderr
