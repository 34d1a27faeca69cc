"""Messages faster than the autopilot's tick arrive at the requested rate. Other clients do not notice."""

import numpy as np
import pytest

from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
from foundation.mavlink import Packer, Parser, dialect
from vehicles import airframe

IMU, ATTITUDE = dialect.MAVLINK_MSG_ID_HIGHRES_IMU, dialect.MAVLINK_MSG_ID_ATTITUDE


class Client:
    """An in-memory client of one vehicle on the ground."""

    def __init__(self) -> None:
        self.vehicle = SimulatedVehicle(
            0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=3, origin=(47.4, 8.5, 488.0)
        )
        self.port = self.vehicle.open_port("minimal")
        self._packer, self._parser = Packer(245, 190), Parser()
        self.steps: list[int] = []  # ms of every call of the compiled loop
        loop = self.vehicle._fused.advance

        def advance(steps: int) -> None:
            self.steps.append(steps)
            loop(steps)

        self.vehicle._fused.advance = advance  # type: ignore[method-assign]
        self.hear(1.5)  # until the sensors have data

    def ask(self, message: int, interval_us: float) -> None:
        command = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
        self.port.receive(
            self._packer.pack(
                dialect.MAVLink_command_long_message(1, 1, command, 0, message, interval_us, 0, 0, 0, 0, 0)
            )
        )

    def hear(self, seconds: float, kind: str = "") -> list[dialect.MAVLink_message]:
        messages = []
        for _ in range(round(seconds * 100)):
            self.vehicle.advance()
            messages += self._parser.feed(self.port.take())
        return [message for message in messages if message.get_type() == kind]


@pytest.mark.parametrize("rate", [125, 200, 250, 400, 1000])
def test_inertial_samples_arrive_at_the_requested_rate(rate):
    client = Client()
    client.ask(IMU, 1e6 / rate)
    client.hear(0.1)
    messages = client.hear(2.0, "HIGHRES_IMU")
    assert len(messages) == pytest.approx(2 * rate, abs=1)
    stamps = np.array([message.time_usec for message in messages])
    gaps = np.diff(stamps)
    assert gaps.min() > 0
    # a due sample leaves after the loop step at which it was due, never later
    assert abs(gaps - 1e6 / rate).max() <= max(client.steps[-10:]) * 1000
    samples = {(message.xacc, message.yacc, message.zacc) for message in messages}
    assert len(samples) == len(messages)  # no sample is sent twice


def test_other_streams_keep_their_rates_beside_a_fast_stream():
    client = Client()
    client.ask(ATTITUDE, 40_000)
    client.ask(IMU, 4_000)
    client.hear(0.1)
    messages = client.hear(4.0, "ATTITUDE")
    assert len(messages) == pytest.approx(100, abs=1)


def test_a_fast_stream_does_not_change_the_flight_by_a_bit():
    plain, fast = Client(), Client()
    fast.ask(IMU, 4_000)
    for each in (plain, fast):
        each.hear(1.0)
    assert plain.vehicle.plant.truth.tobytes() == fast.vehicle.plant.truth.tobytes()
    assert plain.vehicle.plant.sensors.tobytes() == fast.vehicle.plant.sensors.tobytes()
    assert plain.vehicle.core.estimate.tobytes() == fast.vehicle.core.estimate.tobytes()


def test_fast_steps_run_only_for_requested_fast_streams():
    client = Client()
    assert set(client.steps) == {10}
    client.ask(IMU, 5_000)
    client.hear(0.1)
    assert client.steps[-2:] == [5, 5]
    client.ask(IMU, -1)
    client.hear(0.1)
    assert client.steps[-2:] == [10, 10]
    other = client.vehicle.open_port("onboard")
    client.hear(0.1)
    assert client.steps[-2:] == [10, 10]  # PX4's own rates are no faster than the tick
    assert other.take()
