"""Flight logs are listed, downloaded and erased by MAVLink clients."""

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot.mavlink.node import TRANSFERS_PER_TICK
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench, Client

EVERYTHING = 0xFFFFFFFF
SIZES = (1000, 90 * 7, 0, 5000)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    """A bench with four logs of reproducible bytes."""
    generator = random.Random(1)
    for number, size in enumerate(SIZES, start=1):
        (tmp_path / f"log{number:03d}.ulg").write_bytes(generator.randbytes(size))
    bench = Bench(profile="minimal", log_dir=tmp_path)
    bench.client.forget()
    return bench


def content(bench: Bench, number: int) -> bytes:
    return (bench.log.directory.folder / f"log{number + 1:03d}.ulg").read_bytes()


def entries(bench: Bench, first: int = 0, last: int = 0xFFFF) -> list[dialect.MAVLink_message]:
    bench.client.forget()
    bench.client.send(dialect.MAVLink_log_request_list_message(1, 1, first, last))
    bench.run(0.1)
    return bench.client.of("LOG_ENTRY")


def downloaded(bench: Bench, number: int, offset: int = 0, count: int = EVERYTHING) -> bytes:
    bench.client.forget()
    bench.client.send(dialect.MAVLink_log_request_data_message(1, 1, number, offset, count))
    while bench.client.port.transfers:
        bench.tick()
        bench.client.drain()
    data = b""
    for m in bench.client.of("LOG_DATA"):
        assert m.ofs == offset + len(data)
        assert m.id == number
        data += bytes(m.data[: m.count])
    return data


def test_the_log_list_has_numbers_and_sizes(bench: Bench) -> None:
    listed = entries(bench)
    assert [(m.id, m.size, m.num_logs, m.last_log_num) for m in listed] == [(i, s, 4, 3) for i, s in enumerate(SIZES)]
    assert all(m.time_utc > 0 for m in listed)
    assert [m.id for m in entries(bench, 1, 2)] == [1, 2]


def test_an_empty_log_list_is_answered() -> None:
    assert [m.num_logs for m in entries(Bench(profile="minimal"))] == [0]


@pytest.mark.parametrize("number", range(4))
def test_a_log_is_downloaded_completely(bench: Bench, number: int) -> None:
    assert downloaded(bench, number) == content(bench, number)
    assert bench.client.of("LOG_DATA")[-1].count < 90  # a short message marks the end for clients


@given(offset=st.integers(0, 6000), count=st.integers(0, 2000))
@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_byte_range_can_be_downloaded(bench: Bench, offset: int, count: int) -> None:
    assert downloaded(bench, 3, offset, count) == content(bench, 3)[offset : offset + count]


def test_a_tick_sends_a_limited_number_of_messages_and_log_request_end_stops_them(bench: Bench) -> None:
    bench.client.send(dialect.MAVLink_log_request_data_message(1, 1, 3, 0, EVERYTHING))
    bench.tick()
    assert len(bench.client.of("LOG_DATA")) == TRANSFERS_PER_TICK
    bench.client.send(dialect.MAVLink_log_request_end_message(1, 1))
    bench.run(0.2)
    assert len(bench.client.of("LOG_DATA")) == TRANSFERS_PER_TICK


def test_a_download_waits_for_a_client_that_does_not_read(bench: Bench) -> None:
    path = bench.log.directory.folder / "log004.ulg"
    path.write_bytes(bytes(1_000_000))
    bench.client.send(dialect.MAVLink_log_request_data_message(1, 1, 3, 0, EVERYTHING))
    bench.run(5.0)
    assert len(bench.client.of("LOG_DATA")) < 300
    for _ in range(30):
        bench.run(0.4)
        bench.client.drain()
    assert sum(m.count for m in bench.client.of("LOG_DATA")) > 400_000


def test_a_log_that_does_not_exist_is_empty(bench: Bench) -> None:
    assert downloaded(bench, 99) == b""
    assert bench.client.of("LOG_DATA")[0].count == 0


def test_a_log_erased_during_its_download_ends(bench: Bench) -> None:
    bench.client.send(dialect.MAVLink_log_request_data_message(1, 1, 3, 0, EVERYTHING))
    (bench.log.directory.folder / "log004.ulg").unlink()
    bench.run(0.2)
    assert bench.client.of("LOG_DATA")[-1].count == 0


def test_erase_keeps_the_log_being_written(bench: Bench) -> None:
    bench.commander.arm()
    bench.run(1.0)
    bench.client.send(dialect.MAVLink_log_erase_message(1, 1))
    assert [m.num_logs for m in entries(bench)] == [1]
    bench.commander.disarm(force=True)
    bench.run(0.1)
    assert downloaded(bench, 0).startswith(b"ULog")


def test_two_clients_download_at_once(bench: Bench) -> None:
    other = Client(bench.autopilot.open_port("minimal"), 255, 190)
    for client, number in ((bench.client, 0), (other, 3)):
        client.send(dialect.MAVLink_log_request_data_message(1, 1, number, 0, EVERYTHING))
    bench.run(1.0)
    for client, number in ((bench.client, 0), (other, 3)):
        assert b"".join(bytes(m.data[: m.count]) for m in client.of("LOG_DATA")) == content(bench, number)
