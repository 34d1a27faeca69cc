"""Mission items around the bench's home, and functions that upload and download them."""

import math

from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Client

ACCEPTED, UNSUPPORTED = dialect.MAV_MISSION_ACCEPTED, dialect.MAV_MISSION_UNSUPPORTED
HOME = (47.397742, 8.545594)


def item(seq: int, command: int = 16, *, frame: int = 6, p: tuple[float, ...] = (0, 0, 0, math.nan), north: float = 0.0,
         east: float = 0.0, z: float = 10.0, kind: int = 0) -> dialect.MAVLink_message:  # fmt: skip
    x = round((HOME[0] + north / 111_195) * 1e7)
    y = round((HOME[1] + east / 111_195 / math.cos(math.radians(HOME[0]))) * 1e7)
    return dialect.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *p, x, y, z, kind)


def upload(client: Client, items: list[dialect.MAVLink_message], kind: int = 0) -> int:
    """Upload the items in the order of the requests; return the result of the MISSION_ACK."""
    client.forget()
    client.send(dialect.MAVLink_mission_count_message(1, 1, len(items), kind))
    for _ in range(2 * len(items) + 2):
        acks = client.of("MISSION_ACK")
        if acks:
            assert acks[-1].mission_type == kind
            return int(acks[-1].type)
        client.send(items[client.of("MISSION_REQUEST_INT")[-1].seq])
    raise AssertionError("no MISSION_ACK")


def download(client: Client, kind: int = 0) -> list[dialect.MAVLink_message]:
    client.forget()
    client.send(dialect.MAVLink_mission_request_list_message(1, 1, kind))
    count = client.of("MISSION_COUNT")[-1].count
    for seq in range(count):
        client.send(dialect.MAVLink_mission_request_int_message(1, 1, seq, kind))
    client.send(dialect.MAVLink_mission_ack_message(1, 1, ACCEPTED, kind))
    return client.of("MISSION_ITEM_INT")


PLANS = {
    0: [
        item(0, 22, p=(0, 0, 0, math.nan)),
        item(1, 16, north=20.0),
        item(2, 178, frame=2, p=(1, 3.5, -1, 0), z=0),
        item(3, 21),
    ],
    1: [item(i, 5001, frame=5, p=(3, 0, 0, 0), north=n, east=e, kind=1)
        for i, (n, e) in enumerate([(-50, -50), (90, 0), (-50, 50)])] + [item(3, 5004, p=(4, 0, 0, 0), kind=1)],
    2: [item(0, 5100, north=30.0, z=0.0, kind=2)],
}  # fmt: skip
