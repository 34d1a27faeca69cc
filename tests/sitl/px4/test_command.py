"""What the command line says to words that do not go together, and a PX4 that cannot be had."""

import itertools
import subprocess
import sys

import pytest

from dronecats.cli.main import main
from dronecats.sitl.config import SimulatorConfig
from dronecats.sitl.px4.simulator import UDP_PORTS, Px4Simulator, free_instance
from dronecats.sitl.sockets import UdpPort
from foundation.errors import InfrastructureError
from hil.simulator.server import PORT, SimulatorServer
from tests.support.command_line import DRONECATS


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (["fly", "--sitl", "--px4", "px4"], "--autopilot px4"),
        (["sitl", "--px4", "px4"], "--autopilot px4"),
        (["sitl", "--autopilot", "px4", "--instance", "8", "--count", "3"], "0 to 9"),
        (["sitl", "--autopilot", "px4", "--airframe", "hexa"], "hexa"),
        (["sitl", "--autopilot", "px4", "--instance", "7", "--px4", "no-such-px4"], "no-such-px4"),
        (["sitl", "--autopilot", "px4", "--instance", "7", "--px4", ""], "--px4"),
    ],
)
def test_wrong_words_are_one_sentence_and_status_2(words, word, capsys, tmp_path):
    state = ["--state", str(tmp_path)] if words[0] == "sitl" else []
    assert main([*words, *state]) == 2
    assert word in capsys.readouterr().err


def turn_for_ever(simulator):
    while True:
        simulator.turn()


def test_a_px4_that_ends_before_it_answered_is_an_error_that_names_its_log(tmp_path):
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


def test_instances_in_use_are_passed_over():
    first = free_instance(1)
    server = SimulatorServer(PORT + first)
    try:
        second = free_instance(1)
        assert second != first
        udp = UdpPort(("127.0.0.1", UDP_PORTS[1] + second), None, bytes, lambda data: None)
        try:
            assert free_instance(1) not in (first, second)
        finally:
            udp.close()
    finally:
        server.close()


def test_no_time_passes_until_px4_has_come(tmp_path):
    """The process as a user starts it: it says what it waits for, and an interrupt ends it with status 0."""
    instance = str(free_instance(1))
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
