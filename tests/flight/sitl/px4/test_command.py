"""Error messages of the command line for conflicting options, and for a PX4 that does not start."""

import itertools
import subprocess
import sys
from typing import Any

import pytest

from dronecats.cli.main import main
from dronecats.flight.sitl import px4 as simulator
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.px4 import INSTANCES, UDP_PORTS, Px4Simulator, free_servers
from dronecats.flight.sitl.simulation import build
from dronecats.flight.sitl.sockets import UdpPort
from foundation.errors import InfrastructureError, UsageError
from hil.simulator import PORT, SimulatorServer
from tests.support.command_line import DRONECATS
from tests.support.ports import free_instance


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (["fly", "--sitl", "--px4", "px4"], "--autopilot px4"),
        (["fly", "--sitl", "--keep-ulog"], "--px4"),
        (["fly", "--sitl", "--autopilot", "px4", "--keep-ulog"], "--px4"),
        (["sitl", "--px4", "px4"], "--autopilot px4"),
        (["sitl", "--autopilot", "px4", "--instance", "8", "--count", "3"], "0 to 9"),
        (["sitl", "--autopilot", "px4", "--airframe", "hexa"], "hexa"),
        (["sitl", "--autopilot", "px4", "--instance", "7", "--px4", "no-such-px4"], "no-such-px4"),
        (["sitl", "--autopilot", "px4", "--instance", "7", "--px4", ""], "--px4"),
    ],
)
def test_conflicting_options_end_with_a_message_and_status_2(words, word, capsys, tmp_path):
    state = ["--state", str(tmp_path)] if words[0] == "sitl" else []
    assert main([*words, *state]) == 2
    assert word in capsys.readouterr().err


def turn_for_ever(simulator):
    while True:
        simulator.turn()


def test_the_error_of_a_px4_that_exits_before_it_answers_names_its_log(tmp_path):
    simulator = Px4Simulator(
        SimulatorConfig(
            episode="blocks-commanding-01",
            count=1,
            state_dir=str(tmp_path),
            px4=f"{sys.executable} -c 'import sys; print(\"no {{instance}}\"); sys.exit(5)'",
            restart=True,
        ),
        lambda line: None,
    )
    try:
        with pytest.raises(InfrastructureError, match=r"\b5\b") as error:
            turn_for_ever(simulator)
        log = tmp_path / "vehicle-1" / "px4.log"
        assert str(log) in str(error.value)
        assert log.read_text() == f"no {simulator.instance}\n"
    finally:
        simulator.close()


def test_the_newest_px4_log_is_kept_after_px4_exits(tmp_path):
    """PX4 writes two logs. It completes the newest one when it exits."""
    script = tmp_path / "px4.py"
    script.write_text(
        "import pathlib, signal, sys, time\n"
        "folder = pathlib.Path('log/2026-01-01'); folder.mkdir(parents=True)\n"
        "(folder / '00_00_01.ulg').write_text('before')\n"
        "newest = folder / '00_00_02.ulg'; newest.write_text('begun')\n"
        "def end(*_):\n    newest.write_text('whole'); sys.exit(0)\n"
        "signal.signal(signal.SIGTERM, end)\n"
        "pathlib.Path('ready').touch()\n"
        "while True:\n    time.sleep(60)\n"
    )
    kept, state = tmp_path / "episode", tmp_path / "state"
    kept.mkdir()
    simulator = Px4Simulator(
        SimulatorConfig(
            episode="blocks-commanding-01", count=1, state_dir=str(state), keep_ulogs=str(kept),
            px4=f"{sys.executable} {script}  {{instance}}",
        ),
        lambda line: None,
    )  # fmt: skip
    try:
        while not (state / "vehicle-1" / "ready").exists():
            simulator.turn()
        assert not list(kept.iterdir())
    finally:
        simulator.close()
    assert {path.name: path.read_text() for path in kept.iterdir()} == {"onboard.ulg": "whole"}


def test_instances_in_use_are_skipped():
    """A simulator uses the TCP port of one instance, and another program uses a UDP port of the next."""
    [server] = free_servers(1)
    first, second = server.port - PORT, free_instance()
    udp = UdpPort(("127.0.0.1", UDP_PORTS[1] + second), None, bytes, lambda data: None)
    try:
        assert second != first
        assert free_instance() not in (first, second)
    finally:
        udp.close()
        server.close()


def test_two_simulators_that_start_at_the_same_time_choose_different_instances(tmp_path, monkeypatch):
    """The second simulator starts after the first has chosen its instance, while the first builds its vehicles."""
    others: list[Any] = []

    def build_later(*arguments, **words):
        monkeypatch.setattr(simulator, "build", build)
        others.append(waiting(tmp_path / "second"))
        return build(*arguments, **words)

    monkeypatch.setattr(simulator, "build", build_later)
    first = waiting(tmp_path / "first")
    try:
        assert first.instance != others[0].instance
    finally:
        first.close()
        others[0].close()


def waiting(folder):
    """Return a simulator whose PX4 never connects, on an instance of its own choice."""
    config = SimulatorConfig(
        episode="blocks-commanding-01",
        count=1,
        state_dir=str(folder),
        px4=f"{sys.executable} -c 'import time; time.sleep(600) # {{instance}}'",
    )
    return Px4Simulator(config, lambda line: None)


def test_the_error_without_a_free_instance_names_the_ports():
    held = [server for server in map(hold, range(INSTANCES)) if server]
    try:
        with pytest.raises(UsageError, match=f"TCP {PORT} to {PORT + INSTANCES - 1}"):
            free_servers(1)
    finally:
        for server in held:
            server.close()


def hold(instance):
    try:
        return SimulatorServer(PORT + instance)
    except UsageError:  # another program uses it
        return None


@pytest.mark.parametrize(("instance", "advice"), [(None, "{instance}"), (INSTANCES - 1, "--instance")])
def test_the_error_for_a_port_in_use_gives_applicable_advice(instance, advice, tmp_path):
    held = hold(instance or 0)
    config = SimulatorConfig(episode="blocks-commanding-01", count=1, instance=instance, state_dir=str(tmp_path))
    try:
        with pytest.raises(UsageError, match=advice):
            Px4Simulator(config, lambda line: None)
    finally:
        if held:
            held.close()


def test_no_simulated_time_passes_until_px4_connects(tmp_path):
    """The process, started like a user starts it, reports that it waits. An interrupt ends it with status 0."""
    instance = str(free_instance())
    words = [*DRONECATS, "sitl", "--autopilot", "px4", "--instance", instance]
    process = subprocess.Popen([*words, "--state", str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        begun = "".join(itertools.takewhile(lambda line: "Ctrl-C" not in line, process.stdout))
        assert str(PORT + int(instance)) in begun
        process.send_signal(2)
        out, _ = process.communicate(timeout=30)
        assert process.returncode == 0
        assert "0.0 s" in out
    finally:
        process.kill()
        process.wait()
