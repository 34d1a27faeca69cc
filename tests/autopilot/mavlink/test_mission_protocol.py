"""Upload and download of missions, fences and rally points, with lost and repeated messages and two clients."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench, Client
from tests.autopilot.plan_client import ACCEPTED, PLANS, UNSUPPORTED, download, item, upload


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_a_downloaded_plan_equals_the_uploaded_plan(bench: Bench, kind: int) -> None:
    assert upload(bench.client, PLANS[kind], kind) == ACCEPTED
    back = download(bench.client, kind)
    assert len(back) == len(PLANS[kind])
    for sent, got in zip(PLANS[kind], back, strict=True):
        for name in ("seq", "frame", "command", "x", "y", "z", "autocontinue", "mission_type"):
            assert getattr(got, name) == getattr(sent, name)
        for name in ("param1", "param2", "param3", "param4"):
            assert getattr(got, name) == pytest.approx(getattr(sent, name), nan_ok=True)
    for other in {0, 1, 2} - {kind}:
        assert download(bench.client, other) == []


def test_an_upload_completes_despite_lost_and_repeated_messages(bench: Bench) -> None:
    client, items = bench.client, PLANS[0]
    client.send(dialect.MAVLink_mission_count_message(1, 1, 4, 0))
    client.send(dialect.MAVLink_mission_count_message(1, 1, 4, 0))  # the client missed the first request
    client.forget()
    bench.run(0.5)
    assert {m.seq for m in client.of("MISSION_REQUEST_INT")} == {0}  # repeated by the vehicle's clock
    client.send(items[0])
    client.send(items[0])
    client.forget()
    client.send(items[2])  # out of order
    assert [m.seq for m in client.of("MISSION_REQUEST_INT")] == [1]
    for each in items[1:]:
        client.send(each)
    assert [m.type for m in client.of("MISSION_ACK")] == [ACCEPTED]
    client.send(items[3])  # a repeat by a client that missed the acknowledgement
    assert [m.type for m in client.of("MISSION_ACK")] == [ACCEPTED, ACCEPTED]
    assert len(download(client)) == 4


def test_an_interrupted_upload_changes_nothing(bench: Bench) -> None:
    client = bench.client
    assert upload(client, PLANS[0]) == ACCEPTED
    client.send(dialect.MAVLink_mission_count_message(1, 1, 2, 0))
    client.send(item(0))
    client.forget()
    bench.run(6.0)
    assert client.of("MISSION_ACK")[-1].type == dialect.MAV_MISSION_OPERATION_CANCELLED
    client.forget()
    bench.run(2.0)
    assert client.of("MISSION_REQUEST_INT") == []
    assert len(download(client)) == 4


def test_two_clients_upload_at_once(bench: Bench) -> None:
    one, two = bench.client, Client(bench.autopilot.open_port("minimal"), 255, 0)
    one.send(dialect.MAVLink_mission_count_message(1, 1, 4, 0))
    two.send(dialect.MAVLink_mission_count_message(1, 1, 4, 1))
    for first, second in zip(PLANS[0], PLANS[1], strict=True):
        one.send(first)
        two.send(second)
    assert [m.type for m in one.of("MISSION_ACK")] == [ACCEPTED]
    assert [m.type for m in two.of("MISSION_ACK")] == [ACCEPTED]
    assert [(m.target_system, m.target_component) for m in two.of("MISSION_ACK")] == [(255, 0)]


@pytest.mark.parametrize(
    ("items", "kind", "result"),
    [
        ([item(0, 85)], 0, UNSUPPORTED),
        ([item(0, frame=1)], 0, dialect.MAV_MISSION_UNSUPPORTED_FRAME),
        ([item(0, z=math.nan)], 0, dialect.MAV_MISSION_INVALID_PARAM7),
        ([item(0, 177, frame=2, p=(5, 1, 0, 0))], 0, dialect.MAV_MISSION_INVALID_PARAM1),
        ([item(0, 5001, p=(3, 0, 0, 0), kind=1), item(1, 5001, p=(3, 0, 0, 0), kind=1)], 1, 6),
        ([item(0, 16, kind=2)], 2, UNSUPPORTED),
    ],
)
def test_invalid_plans_are_rejected(bench: Bench, items: list[dialect.MAVLink_message], kind: int, result: int) -> None:
    assert upload(bench.client, items, kind) == result
    assert download(bench.client, kind) == []


def test_wrong_sizes_kinds_and_sequence_numbers_are_rejected(bench: Bench) -> None:
    client = bench.client
    client.send(dialect.MAVLink_mission_count_message(1, 1, 5000, 0))
    assert client.of("MISSION_ACK")[-1].type == dialect.MAV_MISSION_NO_SPACE
    client.send(dialect.MAVLink_mission_request_int_message(1, 1, 3, 0))
    assert client.of("MISSION_ACK")[-1].type == dialect.MAV_MISSION_INVALID_SEQUENCE
    for kind in (3, 7):
        client.send(dialect.MAVLink_mission_request_list_message(1, 1, kind))
        assert client.of("MISSION_ACK")[-1].type == UNSUPPORTED


def test_clear_all_removes_one_plan_or_all_plans(bench: Bench) -> None:
    client = bench.client
    for kind, plan in PLANS.items():
        assert upload(client, plan, kind) == ACCEPTED
    for _ in range(2):
        client.send(dialect.MAVLink_mission_clear_all_message(1, 1, 1))
        assert client.of("MISSION_ACK")[-1].type == ACCEPTED
    assert [len(download(client, kind)) for kind in (0, 1, 2)] == [4, 0, 1]
    client.send(dialect.MAVLink_mission_clear_all_message(1, 1, 255))
    assert [len(download(client, kind)) for kind in (0, 1, 2)] == [0, 0, 0]


def test_the_current_item_can_be_set(bench: Bench) -> None:
    client = bench.client
    upload(client, PLANS[0])
    current = client.of("MISSION_CURRENT")[-1]
    assert (current.seq, current.total, current.mission_state) == (0, 4, dialect.MISSION_STATE_NOT_STARTED)
    client.send(dialect.MAVLink_mission_set_current_message(1, 1, 1))
    assert client.of("MISSION_CURRENT")[-1].seq == 1
    assert client.command(dialect.MAV_CMD_DO_SET_MISSION_CURRENT, 3) == 0
    assert client.of("MISSION_CURRENT")[-1].seq == 3
    assert client.command(dialect.MAV_CMD_DO_SET_MISSION_CURRENT, 9) == dialect.MAV_RESULT_DENIED
    client.send(dialect.MAVLink_mission_set_current_message(1, 1, 99))
    assert client.of("MISSION_CURRENT")[-1].seq == 3
    assert any("99" in text for text in client.texts())


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 5), st.integers(0, 3), st.integers(0, 65535),
                          st.floats(width=32)), max_size=30))  # fmt: skip
def test_no_order_of_messages_causes_a_handler_error(script: list[tuple[int, int, int, int, float]]) -> None:
    client = BENCH.client
    makers = (
        lambda s, k, c, z: dialect.MAVLink_mission_count_message(1, 1, s, k),
        lambda s, k, c, z: dialect.MAVLink_mission_item_int_message(1, 1, s, s, c, 0, 1, z, z, z, z, c, c, z, k),
        lambda s, k, c, z: dialect.MAVLink_mission_item_message(1, 1, s, s, 16, 0, 1, z, z, z, z, z, z, z, k),
        lambda s, k, c, z: dialect.MAVLink_mission_request_int_message(1, 1, s, k),
        lambda s, k, c, z: dialect.MAVLink_mission_clear_all_message(1, 1, k),
        lambda s, k, c, z: dialect.MAVLink_mission_set_current_message(1, 1, c),
        lambda s, k, c, z: dialect.MAVLink_mission_ack_message(1, 1, s, k),
    )
    for which, seq, kind, number, z in script:
        client.send(makers[which](seq, kind, number, z))
        BENCH.tick()
    client.forget()
    assert BENCH.autopilot.node.handler_errors == 0


BENCH = Bench(profile="minimal")
