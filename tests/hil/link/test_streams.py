"""The link repeats telemetry requests until the messages arrive, and reduces rates to fit the wire."""

from foundation.mavlink import MODES, dialect
from hil.link.link import Link
from hil.link.streams import FAST, OFFERED, WATCHED, Streams
from tests.hil.link.scripted_vehicle import ScriptedVehicle

POSITION = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
ODOMETRY = dialect.MAVLINK_MSG_ID_ODOMETRY


def receive(streams, share, begin_us, seconds=3.0, foreign=0):
    """Let all wanted messages arrive at `share` of their rate, and return the requests that follow."""
    streams.check(begin_us)
    for message_id, interval_us in streams.wanted.items():
        for _ in range(round(share * seconds * 1e6 / interval_us)):
            streams.saw(message_id, 40)
    for _ in range(foreign):
        streams.saw(ODOMETRY, 240)
    return streams.check(begin_us + round(seconds * 1e6))


def test_nothing_is_requested_while_all_messages_arrive():
    assert receive(Streams(), 1.0, 1_000_000) == []


def test_missing_messages_are_requested_again():
    streams = Streams()
    streams.check(0)
    for message_id, interval_us in WATCHED.items():
        if message_id != POSITION:
            for _ in range(3_000_000 // interval_us):
                streams.saw(message_id, 40)
    assert [(r.message_id, r.interval_us) for r in streams.check(3_000_000)] == [(POSITION, 50_000)]


def test_on_a_full_wire_unused_streams_stop_and_then_rates_fall_to_5_hz():
    streams = Streams()
    first = receive(streams, 0.4, 0, foreign=100)
    assert [(r.message_id, r.interval_us) for r in first] == [(ODOMETRY, -1)]
    assert streams.silenced == {ODOMETRY}
    for begin_us, interval_us in ((10_000_000, 100_000), (20_000_000, 200_000)):
        assert {r.interval_us for r in receive(streams, 0.4, begin_us)} == {interval_us}
    assert {(r.message_id, r.interval_us) for r in receive(streams, 0.4, 30_000_000)} == {(i, 200_000) for i in FAST}


def test_single_messages_are_requested_until_they_arrive():
    streams = Streams()
    assert dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION in streams.once()
    streams.saw(dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 78)
    assert dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION not in streams.once()


class LateFix(ScriptedVehicle):
    """Sends all streams that a link wants. It accepts requests for its origin, but has no origin before 5 s."""

    def step(self):
        super().step()
        if self.time_ms % 1000 == 0:
            self.say(dialect.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 9))
            self.say(dialect.MAVLink_current_mode_message(0, MODES["HOLD"].custom_mode, 0))

    def command(self, message):
        super().command(message)
        request = (message.command, message.param1)
        if (
            request == (dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
            and self.time_ms > 5000
        ):
            self.say(dialect.MAVLink_gps_global_origin_message(474000000, 85000000, 488000))


def test_the_origin_is_requested_until_it_arrives():
    vehicle = LateFix()
    link = Link(vehicle.transport())
    link.connect(10.0)
    assert link.state.origin is None
    link.wait(6.0)
    assert link.state.origin == (47.4, 8.5, 488.0)
    before = len(vehicle.commands)
    link.wait(2.0)
    later = [p1 for command, p1, *_ in vehicle.commands[before:] if command == dialect.MAV_CMD_REQUEST_MESSAGE]
    assert dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN not in later


def test_a_clock_restart_restarts_the_count():
    streams = Streams()
    streams.check(100_000_000)
    assert streams.check(1_000_000) == []


def test_a_message_that_does_not_fit_on_the_wire_stops_unwanted_streams():
    streams = Streams()
    for begin_us in (0, 3_000_000):
        streams.check(begin_us)
        for message_id, interval_us in WATCHED.items():
            if message_id != dialect.MAVLINK_MSG_ID_SYS_STATUS:
                for _ in range(3_000_000 // interval_us):
                    streams.saw(message_id, 40)
        for _ in range(100):
            streams.saw(ODOMETRY, 240)
    requests = streams.check(6_000_000)
    assert {(r.message_id, r.interval_us) for r in requests} == {
        (dialect.MAVLINK_MSG_ID_SYS_STATUS, 500_000),
        (ODOMETRY, -1),
    }


def test_closing_a_link_resets_every_stream_to_the_autopilots_default_rate():
    vehicle = ScriptedVehicle()
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.streams.silenced.add(ODOMETRY)
    vehicle.commands.clear()
    link.close()
    given_back = {int(named) for command, named, interval, _ in vehicle.commands if (command, interval) == (511, 0)}
    assert given_back == {*link.streams.wanted, *OFFERED, ODOMETRY}


def test_a_message_that_the_autopilot_lacks_does_not_reduce_the_rates():
    streams = Streams()
    for begin_us in range(0, 30_000_000, 3_000_000):
        requests = streams.check(begin_us)
        assert {r.message_id for r in requests} <= {dialect.MAVLINK_MSG_ID_CURRENT_MODE}
        for message_id, interval_us in WATCHED.items():
            if message_id != dialect.MAVLINK_MSG_ID_CURRENT_MODE:
                for _ in range(3_000_000 // interval_us):
                    streams.saw(message_id, 40)
    assert streams.slowed == 0
    for begin_us in (40_000_000, 43_000_000, 46_000_000):  # a full wire is still detected
        receive(streams, 0.4, begin_us)
    assert streams.slowed > 0
