"""A simulated board on a pseudo-terminal plays recorded messages of a real PX4 in HIL mode to our simulator."""

import itertools
import os
import pty
import select
import socket
import threading
import time
import tty

import pytest

from dronecats.cli.main import main
from dronecats.flight.sitl.board_simulator import BoardSimulator, BoardVehicle
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.simulation import BootPose
from foundation.errors import UsageError
from foundation.mavlink import Packer, Parser, dialect
from foundation.wire import Frames, is_frame
from hil.link.transport import connect
from hil.simulator import BoardLine, sensor_period_us
from tests.hil.simulator.stand_in import exchange
from vehicles import airframe

SPEECH = exchange("board.jsonl")
HIL = 32  # MAV_MODE_FLAG_HIL_ENABLED


def heartbeat(base_mode):
    return Packer(1, 1).pack(dialect.MAVLink_heartbeat_message(2, dialect.MAV_AUTOPILOT_PX4, base_mode, 0, 4, 3))


class Board:
    """The board's end of a serial line."""

    def __init__(self, path):
        self.master, self.slave = pty.openpty()
        tty.setraw(self.master)
        tty.setraw(self.slave)
        path.unlink(missing_ok=True)
        path.symlink_to(os.ttyname(self.slave))
        self.received = b""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def say(self, data):
        os.write(self.master, data)

    def play(self, speech):
        began_s = time.monotonic()
        for at_s, data in speech:  # sleeps, because the test replays recorded times
            time.sleep(max(0.0, began_s + at_s - time.monotonic()))
            self.say(data)

    def messages(self):
        return Parser().feed(self.received)

    def count(self, name):
        return sum(m.get_type() == name for m in self.messages())

    def unplug(self):
        self._over.set()
        self._thread.join(10.0)
        os.close(self.master)
        os.close(self.slave)

    def _listen(self):
        while not self._over.is_set():
            if select.select([self.master], [], [], 0.05)[0]:
                self.received += os.read(self.master, 65536)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "board"


@pytest.fixture
def board(path):
    board = Board(path)
    yield board
    if not board._over.is_set():
        board.unplug()


@pytest.fixture
def vehicle(path, board):
    url = f"serial://{path}:921600"
    vehicle = BoardVehicle(
        0,
        airframe.load("x500"),
        BootPose((0.0, 0.0, 0.0), 0.0),
        seed=0,
        origin=(47.4, 8.5, 488.0),
        line=BoardLine(lambda: connect(url), Packer(1, 51)),
        period_us=sensor_period_us(url),
    )
    vehicle.plant.advance(0)  # compiles
    vehicle.keeper.restart()
    yield vehicle
    vehicle.close()


def until(vehicle, condition):
    while not condition():
        vehicle.advance()


def test_a_board_that_is_not_in_hil_mode_gets_no_sensors(vehicle, board):
    board.say(heartbeat(base_mode=1))
    until(vehicle, lambda: vehicle.line.present)
    for _ in range(20):
        vehicle.advance()
    assert not vehicle.is_flying
    until(vehicle, lambda: board.count("HEARTBEAT"))  # but it gets heartbeats
    assert {m.get_type() for m in board.messages()} == {"HEARTBEAT"}


def test_a_recorded_board_gets_its_sensors_in_real_time_and_drives_the_rotors(vehicle, board):
    player = threading.Thread(target=board.play, args=(SPEECH,))
    player.start()
    until(vehicle, lambda: vehicle.is_flying)
    began_us, before = vehicle.time_us, board.count("HIL_SENSOR")
    until(vehicle, lambda: vehicle.time_us >= began_us + 1_000_000)
    until(vehicle, lambda: board.count("HIL_SENSOR") >= before + 240)
    player.join(20.0)
    got = board.messages()
    assert {"HIL_SENSOR", "HIL_GPS", "HEARTBEAT"} == {m.get_type() for m in got}  # no truth: PX4 would use it to fly
    times = [m.time_usec for m in got if m.get_type() == "HIL_SENSOR"]
    assert {b - a for a, b in itertools.pairwise(times)} == {4000}
    assert vehicle.plant.actuators["command"][:4].tolist() == pytest.approx([0.15] * 4)  # disarmed, as in the recording


def test_clients_get_all_messages_except_motor_outputs_byte_for_byte(vehicle, board):
    for _, data in SPEECH:
        board.say(data)
        vehicle.line.exchange()
    speech = b"".join(data for _, data in SPEECH)
    frames = filter(is_frame, Frames().feed(speech))
    wanted = b"".join(frame for frame in frames if frame[7:10] != b"\x5d\x00\x00")
    received = vehicle.line.take()
    while len(received) < len(wanted):
        vehicle.line.exchange()
        received += vehicle.line.take()
    assert received == wanted
    assert len(Parser().feed(wanted)) > 50
    assert len(wanted) < len(speech)


def test_messages_of_a_client_reach_the_board_unchanged(vehicle, board):
    words = Packer(255, 190).pack(dialect.MAVLink_param_request_list_message(1, 1))
    vehicle.line.give(words)
    until(vehicle, lambda: words in board.received)


def test_rotors_stop_when_the_board_falls_silent(vehicle, board):
    motors = dialect.MAVLink_hil_actuator_controls_message(1, [0.8] * 4 + [0.0] * 12, 1 | HIL | 128, 0)
    board.say(heartbeat(HIL | 128) + Packer(1, 1).pack(motors))
    until(vehicle, lambda: vehicle.plant.actuators["armed"])
    assert vehicle.plant.actuators["command"][0] == pytest.approx(0.15 + 0.85 * 0.8)
    until(vehicle, lambda: not vehicle.plant.actuators["armed"])
    assert not vehicle.is_flying


def test_the_simulator_reconnects_after_the_cable_was_unplugged(vehicle, board, path):
    board.say(heartbeat(HIL))
    until(vehicle, lambda: vehicle.line.in_hil)
    board.unplug()
    until(vehicle, lambda: not vehicle.line.present)
    time_us = vehicle.time_us
    again = Board(path)
    try:
        until(vehicle, lambda: again.count("HEARTBEAT"))
        again.say(heartbeat(HIL))
        until(vehicle, lambda: again.count("HIL_SENSOR"))
        assert vehicle.time_us > time_us
    finally:
        again.unplug()


def test_frames_are_parsed_between_noise_and_across_chunk_boundaries():
    one, two = heartbeat(0), heartbeat(HIL)
    old = bytes([0xFE, 1, 0, 1, 1, 200, 7, 0, 0])  # MAVLink 1, one byte of payload
    stream = b"\r\nNuttShell\r\n" + one + old + b"\x00" + two
    for cut in range(len(stream)):
        frames = Frames()
        units = frames.feed(stream[:cut]) + frames.feed(stream[cut:])
        assert list(filter(is_frame, units)) == [one, old, two]


@pytest.mark.parametrize(
    ("url", "period_us"),
    [
        ("serial:///dev/ttyACM0:921600", 4000),
        ("serial:///dev/ttyUSB0:460800", 4000),
        ("serial:///dev/ttyACM0", 4000),
        ("serial:///dev/ttyACM0:57600", 4000),  # USB ignores the baud rate
        ("serial:///dev/cu.usbmodem01", 4000),
        ("serial:///dev/serial/by-id/usb-3D_Robotics_PX4_FMU_v5.x_0-if00:57600", 4000),
        ("udpin://0.0.0.0:14560", 4000),
    ],
)
def test_the_sensor_rate_fits_the_baud_rate(url, period_us):
    assert sensor_period_us(url) == period_us
    if "ttyUSB" in url:
        assert 10 * 74 * 1e6 / period_us <= 0.5 * int(url.rpartition(":")[2])


def test_a_serial_line_that_is_too_slow_is_rejected(capsys):
    for url in (
        "serial:///dev/ttyUSB0:57600",
        "serial:///dev/ttyUSB0",  # has the default baud rate
        "serial:///dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0:57600",
    ):
        with pytest.raises(UsageError, match=r"57600 .* 39 "):
            sensor_period_us(url)
    assert main(["sitl", "--hitl", "serial:///dev/ttyUSB0:57600"]) == 2
    assert "460800" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--speed", "2"], ["--count", "2"], ["--px4", "px4"]])
def test_options_that_a_board_does_not_support_are_rejected(words, capsys):
    assert main(["sitl", "--hitl", "serial:///dev/ttyACM0:921600", *words]) == 2
    assert words[0] in capsys.readouterr().err


def free_instance():
    for instance in range(60, 100):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as other:
            try:
                one.bind(("127.0.0.1", 14580 + instance))
                other.bind(("127.0.0.1", 14540 + instance))
            except OSError:
                continue
            return instance
    raise AssertionError("no free instance")


def test_a_client_on_the_offboard_port_exchanges_messages_with_the_board(board, path):
    instance = free_instance()
    notices: list[str] = []
    client = connect(f"udpin://127.0.0.1:{14540 + instance}")
    simulator = BoardSimulator(
        SimulatorConfig(episode="blocks-commanding-01", instance=instance, hitl=f"serial://{path}:921600"),
        notices.append,
    )
    try:
        simulator.ready()
        board.say(heartbeat(base_mode=1))
        data = b""
        while not data:
            simulator.turn()
            data = client.receive(0.0)
        assert data == heartbeat(base_mode=1)
        words = Packer(255, 190).pack(dialect.MAVLink_param_request_list_message(1, 1))
        client.send(words)
        while words not in board.received:
            simulator.turn()
        assert any("SYS_HITL" in line for line in notices)
    finally:
        simulator.close()
        client.close()
