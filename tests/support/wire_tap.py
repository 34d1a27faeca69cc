"""Records the traffic between an agent and a vehicle."""

import contextlib
import socket
import threading
import time

from foundation.mavlink import MODES, Packer, Parser, dialect


class Tap(threading.Thread):
    """A relay between an agent and a vehicle that records the traffic in order."""

    def __init__(self, vehicle_port):
        super().__init__(daemon=True)
        self.near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.near.bind(("127.0.0.1", 0))
        self.far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.far.connect(("127.0.0.1", vehicle_port))
        for end in (self.near, self.far):
            end.settimeout(0.1)
        self.passed, self.lock, self.open = [], threading.Lock(), True
        self.agent, self.packer = None, Packer(255, 190)
        self.start()
        threading.Thread(target=self.back, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *failure):
        self.open = False
        self.join()

    @property
    def url(self):
        return f"udpout://127.0.0.1:{self.near.getsockname()[1]}"

    def note(self, parser, data, side):
        with self.lock:
            self.passed += [(side, message) for message in parser.feed(data)]

    def run(self):
        parser = Parser()
        while self.open:
            try:
                data, self.agent = self.near.recvfrom(65536)
            except TimeoutError:
                continue
            with contextlib.suppress(ConnectionRefusedError):  # the vehicle is gone
                self.far.send(data)
            self.note(parser, data, "agent")

    def back(self):
        parser = Parser()
        while self.open:
            try:
                data = self.far.recv(65536)
            except (TimeoutError, ConnectionRefusedError):
                continue
            if self.agent:
                self.near.sendto(data, self.agent)
            self.note(parser, data, "vehicle")

    def order(self, mode):
        """Switch the mode as another client does, for example a ground station."""
        command = dialect.MAVLink_command_long_message(1, 1, 176, 0, 1, MODES[mode].main, MODES[mode].sub, 0, 0, 0, 0)
        self.far.send(self.packer.pack(command))

    def of(self, side, kind):
        with self.lock:
            return [m for s, m in self.passed if s == side and m.get_type() == kind]

    def until(self, wanted, seconds=60.0, flight=None):
        """Wait until `wanted` returns true. Fail after `seconds`, or if `flight` ends."""
        ends = time.monotonic() + seconds
        while not wanted():
            assert time.monotonic() < ends, "it never came"
            assert flight is None or flight.poll() is None, flight.communicate()[1]
            time.sleep(0.02)


def setpoints(tap):
    """Return every setpoint that the agent sent."""
    return tap.of("agent", "SET_POSITION_TARGET_LOCAL_NED")


def orders(tap):
    """Return the commands that the agent sent, without requests for telemetry."""
    return {m.command for m in tap.of("agent", "COMMAND_LONG")} - {511, 512}
