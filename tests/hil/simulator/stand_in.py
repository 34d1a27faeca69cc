"""A client that plays PX4 on the simulator interface, for tests of the messages on the wire."""

import contextlib
import json
import socket
import threading
from collections.abc import Callable
from pathlib import Path

from foundation.mavlink import Packer, Parser, dialect

RECORDED = Path(__file__).parent / "recorded"
HEARTBEAT = dialect.MAVLink_heartbeat_message(0, dialect.MAV_AUTOPILOT_PX4, 0, 0, 0, 0)
WANTS_TRUTH = dialect.MAVLink_command_long_message(
    0, 0, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, 5e3, 0, 0, 0, 0, 0
)
Answer = Callable[[dialect.MAVLink_message], bytes]


class StandIn:
    """Connects like PX4, stores all received messages, and answers each HIL_SENSOR with `answer(message)`."""

    def __init__(self, port: int, answer: Answer) -> None:
        self.got: list[dialect.MAVLink_message] = []
        self._answered, self._answered_us = threading.Condition(), 0
        self._answer, self._parser, self._packer = answer, Parser(), Packer(1, 1)
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10.0)
        self._socket.sendall(self._packer.pack(HEARTBEAT) + self._packer.pack(WANTS_TRUTH))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def named(self, name: str) -> list[dialect.MAVLink_message]:
        return [message for message in self.got if message.get_type() == name]

    def close(self) -> None:
        """Close the connection like a killed process."""
        with contextlib.suppress(OSError):  # already closed
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(10.0)
        self._socket.close()

    def keep_up(self, time_us: int) -> None:
        """Wait until all HIL_SENSOR messages up to `time_us` are processed."""
        with self._answered:
            assert self._answered.wait_for(lambda: self._answered_us >= time_us, 60.0), "it reads nothing"

    def _reply(self, sensor: dialect.MAVLink_message) -> None:
        if reply := self._answer(sensor):
            self._socket.sendall(reply)
        with self._answered:
            self._answered_us = sensor.time_usec
            self._answered.notify_all()

    def _run(self) -> None:
        try:
            while data := self._socket.recv(65536):
                for message in self._parser.feed(data):
                    self.got.append(message)
                    if message.get_type() == "HIL_SENSOR":
                        self._reply(message)
        except OSError:
            return


def controls(time_us: int, outputs: tuple[float, ...] = (), armed: bool = False) -> bytes:
    """Return a HIL_ACTUATOR_CONTROLS message of PX4 as bytes."""
    filled = [*outputs, *[0.0] * (16 - len(outputs))]
    return Packer(1, 1).pack(dialect.MAVLink_hil_actuator_controls_message(time_us, filled, 1 | 128 * armed, 1))


def always(*outputs: float, armed: bool = True) -> Answer:
    """Return an `answer` that replies to every sensor message with these outputs."""
    return lambda sensor: controls(sensor.time_usec, outputs, armed)


def silent(sensor: dialect.MAVLink_message) -> bytes:
    """Send no answer, like a PX4 that is still booting."""
    return b""


class Replay:
    """Replays the recorded answers of a real PX4, matched by sensor timestamp and delayed by `later_us`."""

    def __init__(self, name: str, later_us: int = 0) -> None:
        self.frames: dict[int, bytes] = {}
        for message in recorded(name):
            if message.get_type() == "HIL_ACTUATOR_CONTROLS":
                message.time_usec += later_us
                self.frames[message.time_usec] = Packer(1, 1).pack(message)

    def __call__(self, sensor: dialect.MAVLink_message) -> bytes:
        return self.frames.get(sensor.time_usec, b"")


def recorded(name: str) -> list[dialect.MAVLink_message]:
    """Return the messages of a recording of a real PX4's output."""
    parser = Parser()
    messages = parser.feed((RECORDED / name).read_bytes())
    assert parser.bad == 0
    return messages


def exchange(name: str) -> list[tuple[float, bytes]]:
    """Return the pairs (time in s, bytes) of a recorded serial line."""
    lines = (RECORDED / name).read_text(encoding="ascii").splitlines()
    return [(float(at), bytes.fromhex(data)) for at, data in map(json.loads, lines)]
