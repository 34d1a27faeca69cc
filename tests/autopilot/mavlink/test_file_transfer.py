"""MAVLink FTP: reads, writes and errors. No path leads outside the memory card and the log folder."""

import errno
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.mavftp import MAVFTP

from autopilot.mavlink import file_transfer as ftp
from autopilot.mavlink.file_tree import CARD_BYTES, CARD_ENTRIES, IDLE_US, MOST
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench, Client

FUZZ = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
LOG = "/fs/microsd/log/log001.ulg"
CONTENT = bytes(range(256)) * 300 + b"end"  # longer than one burst


class Files:
    """An FTP client that sends one request at a time."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.sequence = 0

    def ask(self, opcode: int, data: bytes | str = b"", *, session: int = 0, offset: int = 0, size: int | None = None,
            sequence: int | None = None) -> ftp.FileRequest:  # fmt: skip
        """Send a request and return the answer."""
        content = data.encode() if isinstance(data, str) else data
        self.sequence = (self.sequence + 2 if sequence is None else sequence) & 0xFFFF
        head = struct.pack("<HBBBBBBI", self.sequence, session, opcode, len(content) if size is None else size, 0, 0, 0,
                           offset)  # fmt: skip
        self.client.forget()
        payload = list((head + content).ljust(251, b"\0"))
        self.client.send(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        (answer,) = self.answers()
        assert answer.sequence == (self.sequence + 1) & 0xFFFF
        return answer

    def answers(self) -> list[ftp.FileRequest]:
        replies = self.client.of("FILE_TRANSFER_PROTOCOL")
        assert all(
            (m.target_system, m.target_component) == (self.client.system, self.client.component) for m in replies
        )
        return [ftp.parsed(bytes(m.payload)) for m in replies]

    def refused(self, opcode: int, data: bytes | str = b"", **fields: int) -> bytes:
        answer = self.ask(opcode, data, **fields)
        assert answer.opcode == ftp.NAK
        return answer.data

    def done(self, opcode: int, data: bytes | str = b"", **fields: int) -> ftp.FileRequest:
        answer = self.ask(opcode, data, **fields)
        assert answer.opcode == ftp.ACK, answer.data
        return answer

    def listed(self, name: str, opcode: int = ftp.LIST_DIRECTORY) -> list[str]:
        lines: list[str] = []
        while True:
            answer = self.ask(opcode, name, offset=len(lines))
            if answer.opcode == ftp.NAK:
                assert answer.data == b"\x06"
                return lines
            lines += answer.data.decode().rstrip("\0").split("\0")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """The log folder. The memory card and a secret file are next to it."""
    (tmp_path / "secret").write_text("not yours")
    (tmp_path / "card").mkdir()
    folder = tmp_path / "log"
    folder.mkdir()
    (folder / "log001.ulg").write_bytes(CONTENT)
    return folder


@pytest.fixture
def bench(root: Path) -> Bench:
    return Bench(profile="minimal", log_dir=root, card_dir=root.parent / "card")


@pytest.fixture
def files(bench: Bench) -> Files:
    return Files(bench.client)


def read(files: Files, name: str) -> bytes:
    opened = files.done(ftp.OPEN_TO_READ, name)
    (size,) = struct.unpack("<I", opened.data)
    data = b""
    while (answer := files.ask(ftp.READ, session=opened.session, offset=len(data), size=239)).opcode == ftp.ACK:
        assert answer.offset == len(data)
        data += answer.data
    assert answer.data == b"\x06"
    assert len(data) == size
    files.done(ftp.TERMINATE_SESSION, session=opened.session)
    return data


def test_directories_are_listed(files: Files) -> None:
    assert files.listed("/") == ["D@PARAM", "Dfs"]
    assert files.listed("fs/") == ["Dmicrosd"]
    assert files.listed("/fs/microsd") == ["Dlog"]
    assert files.listed("/fs/microsd/log") == files.listed("@MAV_LOG") == [f"Flog001.ulg\t{len(CONTENT)}"]
    assert files.listed("/@PARAM")[0].startswith("Fparam.pck\t")


def test_listing_with_time_includes_modification_times(files: Files, root: Path) -> None:
    (root / "folder").mkdir()
    folder, log = files.listed("/fs/microsd/log", ftp.LIST_DIRECTORY_WITH_TIME)
    assert folder.split("\t")[:2] == ["Dfolder", "0"]
    assert log == f"Flog001.ulg\t{len(CONTENT)}\t{int((root / 'log001.ulg').stat().st_mtime)}"


def test_a_long_directory_is_listed_in_several_replies(files: Files, root: Path) -> None:
    names = sorted(["log001.ulg", *(f"{i:03d}{'x' * (i % 200)}" for i in range(120)), "y" * 240])
    for name in names[:-2] + names[-1:]:
        (root / name).touch()
    lines = files.listed("/fs/microsd/log")
    assert len(lines) == len(names)
    assert [line for line in lines if line != "S"] == [
        f"F{name}\t{(root / name).stat().st_size}" for name in names if len(name) < 200
    ]


def test_a_file_is_read_and_its_checksum_is_computed(files: Files) -> None:
    assert read(files, LOG) == CONTENT
    (crc,) = struct.unpack("<I", files.done(ftp.CHECKSUM, LOG).data)
    expected = 0  # CRC-32 bit by bit, as in the description of the protocol
    for byte in CONTENT:
        expected ^= byte
        for _ in range(8):
            expected = expected >> 1 ^ (0xEDB88320 if expected & 1 else 0)
    assert crc == expected


def test_a_burst_streams_the_file_in_bounded_portions(files: Files, bench: Bench) -> None:
    opened = files.done(ftp.OPEN_TO_READ, LOG)
    data, complete, bursts = b"", True, 0
    while len(data) < len(CONTENT):
        assert complete
        files.client.forget()
        head = struct.pack("<HBBBBBBI", 100, opened.session, ftp.BURST_READ, 239, 0, 0, 0, len(data))
        payload = list(head.ljust(251, b"\0"))
        files.client.send(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        for _ in range(15):
            before = len(files.answers())
            bench.tick()
            assert len(files.answers()) - before <= 20
        bursts += 1
        for i, message in enumerate(files.client.of("FILE_TRANSFER_PROTOCOL")):
            answer = ftp.parsed(bytes(message.payload))
            assert (answer.sequence, answer.offset) == (101 + i, len(data))
            data += answer.data
            complete = bool(message.payload[6])
    assert data == CONTENT
    assert bursts == 2
    assert len(bench.autopilot.node.file_sessions) == 1


def test_a_burst_at_the_end_of_the_file_returns_eof(files: Files, bench: Bench) -> None:
    session = files.done(ftp.OPEN_TO_READ, LOG).session
    head = struct.pack("<HBBBBBBI", 7, session, ftp.BURST_READ, 239, 0, 0, 0, len(CONTENT))
    files.client.forget()
    files.client.send(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, list(head.ljust(251, b"\0"))))
    bench.tick()
    (answer,) = files.answers()
    assert (answer.opcode, answer.data) == (ftp.NAK, b"\x06")
    assert files.refused(ftp.BURST_READ, session=99) == b"\x04"


def test_a_terminated_burst_stops(files: Files, bench: Bench) -> None:
    session = files.done(ftp.OPEN_TO_READ, LOG).session
    head = struct.pack("<HBBBBBBI", 9, session, ftp.BURST_READ, 239, 0, 0, 0, 0)
    files.client.send(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, list(head.ljust(251, b"\0"))))
    bench.tick()
    files.client.forget()
    files.done(ftp.TERMINATE_SESSION, session=session)
    bench.run(0.5)
    assert len(files.answers()) == 1


def test_files_are_written_renamed_and_removed(files: Files, root: Path) -> None:
    session = files.done(ftp.CREATE, "/fs/microsd/log/new").session
    for offset in range(0, 1000, 200):
        assert files.done(ftp.WRITE, CONTENT[offset : offset + 200], session=session, offset=offset).offset == offset
    assert files.refused(ftp.READ, session=session, size=10) == b"\x01"  # opened for writing
    files.done(ftp.TERMINATE_SESSION, session=session)
    assert (root / "new").read_bytes() == CONTENT[:1000]
    session = files.done(ftp.OPEN_TO_WRITE, "/fs/microsd/log/new").session
    files.done(ftp.WRITE, b"HELLO", session=session, offset=10)
    files.done(ftp.RESET_SESSIONS)
    assert (root / "new").read_bytes() == CONTENT[:10] + b"HELLO" + CONTENT[15:1000]
    files.done(ftp.TRUNCATE, "/fs/microsd/log/new", offset=12)
    files.done(ftp.MAKE_FOLDER, "/fs/microsd/log/folder")
    files.done(ftp.RENAME, "/fs/microsd/log/new\0/fs/microsd/log/folder/old\0")
    assert (root / "folder" / "old").read_bytes() == CONTENT[:10] + b"HE"
    assert files.refused(ftp.REMOVE_FOLDER, "/fs/microsd/log/folder")[0] == 2  # errno: not empty
    assert files.refused(ftp.MAKE_FOLDER, "/fs/microsd/log/folder") == b"\x08"
    assert files.refused(ftp.RENAME, f"/fs/microsd/log/folder\0{LOG}\0") == b"\x08"
    files.done(ftp.REMOVE_FILE, "/fs/microsd/log/folder/old")
    files.done(ftp.REMOVE_FOLDER, "/fs/microsd/log/folder")
    assert [path.name for path in root.iterdir()] == ["log001.ulg"]


def test_a_client_can_create_rename_and_remove_files_on_the_card(files: Files, root: Path) -> None:
    card = root.parent / "card"
    files.done(ftp.MAKE_FOLDER, "/fs/microsd/etc")
    session = files.done(ftp.CREATE, "/fs/microsd/etc/extras.txt").session
    files.done(ftp.WRITE, b"param set-default", session=session)
    files.done(ftp.TERMINATE_SESSION, session=session)
    assert (card / "etc" / "extras.txt").read_bytes() == b"param set-default"
    assert files.listed("/fs/microsd") == ["Detc", "Dlog"]
    files.done(ftp.RENAME, "/fs/microsd/etc/extras.txt\0/fs/microsd/config.txt\0")
    files.done(ftp.REMOVE_FOLDER, "/fs/microsd/etc")
    assert files.listed("/fs/microsd") == ["Fconfig.txt\t17", "Dlog"]
    assert read(files, "/fs/microsd/config.txt") == b"param set-default"
    assert files.refused(ftp.REMOVE_FOLDER, "/fs/microsd") == b"\x09"
    assert files.refused(ftp.MAKE_FOLDER, "/fs/microsd/log") == b"\x09"
    files.done(ftp.REMOVE_FILE, "/fs/microsd/config.txt")
    assert list(card.iterdir()) == []


def test_a_full_card_rejects_writes_and_accepts_removals(files: Files, root: Path) -> None:
    session = files.done(ftp.CREATE, "/fs/microsd/first").session
    files.done(ftp.TERMINATE_SESSION, session=session)
    with (root.parent / "card" / "large").open("wb") as large:
        large.truncate(CARD_BYTES)  # a sparse file
    full = bytes([2, errno.ENOSPC])
    for folder in ("/fs/microsd", "/fs/microsd/log"):
        assert files.refused(ftp.CREATE, f"{folder}/second") == full
        assert files.refused(ftp.MAKE_FOLDER, f"{folder}/folder") == full
    assert files.refused(ftp.OPEN_TO_WRITE, "/fs/microsd/first") == full
    assert files.refused(ftp.TRUNCATE, "/fs/microsd/first", offset=10) == full
    files.done(ftp.REMOVE_FILE, "/fs/microsd/large")
    for i in range(CARD_ENTRIES - 2):
        (root.parent / "card" / f"{i}").touch()
    assert files.refused(ftp.CREATE, "/fs/microsd/second") == full
    files.done(ftp.REMOVE_FILE, "/fs/microsd/0")
    files.done(ftp.CREATE, "/fs/microsd/second")


def test_errors_have_the_right_codes_and_change_nothing(files: Files, root: Path) -> None:
    (root / "link").symlink_to(root.parent / "secret")
    (root / "up").symlink_to(root.parent)
    (root.parent / "card" / "up").symlink_to(root.parent)
    refusals: list[tuple[int, bytes | str, bytes]] = [
        (ftp.OPEN_TO_READ, "/fs/microsd/log/none", b"\x0a"),
        (ftp.OPEN_TO_READ, "/fs/microsd/log", b"\x0a"),
        (ftp.OPEN_TO_READ, "/etc/passwd", b"\x0a"),
        (ftp.OPEN_TO_READ, "/fs/microsd/log/../secret", b"\x0a"),
        (ftp.OPEN_TO_READ, "/fs/microsd/log/link", b"\x0a"),
        (ftp.OPEN_TO_READ, "/fs/microsd/log/up/secret", b"\x0a"),
        (ftp.OPEN_TO_READ, b"/fs/microsd/log/\xff\xfe", b"\x0a"),
        (ftp.OPEN_TO_READ, "/fs/microsd/log/log001.ulg/below", b"\x0a"),
        (ftp.LIST_DIRECTORY, "/fs/microsd/log/none", b"\x0a"),
        (ftp.LIST_DIRECTORY, "/etc", b"\x0a"),
        (ftp.CHECKSUM, "/fs/microsd/log/../secret", b"\x0a"),
        (ftp.CREATE, "/fs/microsd/log/up/file", b"\x0a"),
        (ftp.CREATE, "/fs/microsd/up/file", b"\x0a"),
        (ftp.CREATE, "/fs/microsd/../file", b"\x0a"),
        (ftp.CREATE, "/fs/other", b"\x0a"),
        (ftp.CREATE, "/file", b"\x0a"),
        (ftp.RENAME, "/fs/microsd/log/log001.ulg\0/fs/microsd/up/gone", b"\x0a"),
        (ftp.CREATE, "@PARAM/param.pck", b"\x09"),
        (ftp.CREATE, "/fs/microsd/log", b"\x09"),
        (ftp.REMOVE_FILE, "/fs/microsd/log/none", b"\x0a"),
        (ftp.REMOVE_FOLDER, "/fs/microsd/log", b"\x09"),
        (ftp.RENAME, "/fs/microsd/log/log001.ulg\0/fs/microsd/log/../gone", b"\x0a"),
        (ftp.RENAME, "/fs/microsd/log/none\0/fs/microsd/log/x", b"\x0a"),
        (ftp.TRUNCATE, "/fs/microsd/log/none", b"\x0a"),
        (ftp.READ, b"", b"\x04"),
        (ftp.WRITE, b"abc", b"\x04"),
        (ftp.TERMINATE_SESSION, b"", b"\x04"),
        (17, b"", b"\x07"),
        (127, b"", b"\x07"),
    ]
    for opcode, data, code in refusals:
        assert files.refused(opcode, data) == code, (opcode, data)
        assert (root.parent / "secret").read_text() == "not yours", (opcode, data)
        assert sorted(path.name for path in root.parent.iterdir()) == ["card", "log", "secret"], (opcode, data)
        assert (root / "log001.ulg").read_bytes() == CONTENT, (opcode, data)


def test_too_much_data_is_rejected(files: Files) -> None:
    assert files.refused(ftp.OPEN_TO_READ, LOG, size=240) == b"\x03"
    session = files.done(ftp.CREATE, "/fs/microsd/log/new").session
    assert files.refused(ftp.WRITE, b"x", session=session, offset=0xFFFFFFF0) == b"\x01"  # no client can fill the disk
    assert files.refused(ftp.TRUNCATE, "/fs/microsd/log/new", offset=0xFFFFFFF0) == b"\x01"


def test_a_repeated_request_is_not_executed_again(files: Files, root: Path, bench: Bench) -> None:
    first = files.done(ftp.MAKE_FOLDER, "/fs/microsd/log/folder", sequence=10)
    assert files.done(ftp.MAKE_FOLDER, "/fs/microsd/log/folder", sequence=10) == first
    assert files.refused(ftp.MAKE_FOLDER, "/fs/microsd/log/folder", sequence=11) == b"\x08"
    opened = files.done(ftp.OPEN_TO_READ, LOG, sequence=20)
    assert files.done(ftp.OPEN_TO_READ, LOG, sequence=20).session == opened.session
    assert len(bench.autopilot.node.file_sessions) == 1


def test_sessions_belong_to_their_client_and_are_limited(files: Files, bench: Bench) -> None:
    other = Files(Client(bench.autopilot.open_port("minimal"), 255, 190))
    assert files.done(ftp.OPEN_TO_READ, LOG).session == 0
    assert files.done(ftp.OPEN_TO_READ, LOG).session == 1
    assert files.done(ftp.OPEN_TO_READ, LOG, session=77).session == 77
    assert other.refused(ftp.READ, session=1, size=5) == b"\x04"
    other.done(ftp.RESET_SESSIONS)
    assert files.done(ftp.READ, session=1, size=5).data == CONTENT[:5]
    for _ in range(MOST - 3):
        files.done(ftp.OPEN_TO_READ, LOG)
    assert other.refused(ftp.OPEN_TO_READ, LOG) == b"\x05"
    bench.run(IDLE_US * 1e-6 + 1)
    other.done(ftp.OPEN_TO_READ, LOG)  # idle sessions of a client expire
    assert len(bench.autopilot.node.file_sessions) == MOST


def test_the_log_being_written_is_protected_but_readable(files: Files, bench: Bench) -> None:
    bench.commander.arm()
    bench.run(1.0)
    name = "/fs/microsd/log/log002.ulg"
    for opcode in (ftp.CREATE, ftp.OPEN_TO_WRITE, ftp.REMOVE_FILE, ftp.TRUNCATE):
        assert files.refused(opcode, name) == b"\x09"
    assert files.refused(ftp.RENAME, f"{name}\0/fs/microsd/log/x\0") == b"\x09"
    assert read(files, name).startswith(b"ULog")


def test_the_parameter_file_contains_the_current_values(files: Files, bench: Bench) -> None:
    bench.autopilot.parameters.set("MIS_TAKEOFF_ALT", 7.25)
    bench.autopilot.parameters.set("COM_RCL_EXCEPT", 4)
    parameters = bench.autopilot.parameters
    for name in ("@PARAM/param.pck", "@PARAM/param.pck?withdefaults=1"):
        decoded = MAVFTP.ftp_param_decode(read(files, name))
        assert {n.decode(): value for n, value, _ in decoded.params} == {n: parameters[n] for n in parameters.names}


NAME_PARTS = st.sampled_from(["fs", "microsd", "log", "..", ".", "", "a", "secret", "up", "@MAV_LOG", "etc", "\\"])


@given(parts=st.lists(NAME_PARTS | st.text(max_size=5), max_size=8), opcode=st.sampled_from(
    [ftp.CREATE, ftp.OPEN_TO_WRITE, ftp.MAKE_FOLDER, ftp.REMOVE_FILE, ftp.REMOVE_FOLDER]))  # fmt: skip
@FUZZ
def test_no_path_leads_outside_the_card_and_the_log_folder(
    bench: Bench, root: Path, parts: list[str], opcode: int
) -> None:
    for link in (root / "up", root.parent / "card" / "up"):
        if not link.is_symlink() and not link.exists():
            link.symlink_to(root.parent)
    Files(bench.client).ask(opcode, "/".join(["", "fs", "microsd", *parts]).encode()[:239])
    assert (root.parent / "secret").read_text() == "not yours"
    assert sorted(path.name for path in root.parent.iterdir()) == ["card", "log", "secret"]
    assert bench.autopilot.node.handler_errors == 0


def test_the_parameter_file_is_readable_without_a_log_folder() -> None:
    files = Files(Bench(profile="minimal").client)
    assert files.listed("/fs/microsd") == []
    assert files.refused(ftp.OPEN_TO_READ, LOG) == b"\x0a"
    assert files.refused(ftp.CREATE, LOG) == b"\x0a"
    assert len(read(files, "@PARAM/param.pck")) > 1000


NAMES = st.sampled_from(
    [b"", b"/", b"..", b"/fs/microsd/log", b"/fs/microsd/log/log001.ulg", b"/fs/microsd/log/../secret",
     b"@PARAM/param.pck", b"/fs/microsd/log/a", b"/fs/microsd/log/a\0/fs/microsd/log/b", b"/fs/microsd/log/b/c",
     b"/fs/microsd/log/b", b"/fs/microsd/c", b"/fs/microsd/c/d", b"/fs/microsd/../secret", b"/fs/microsd/e/../c",
     b"/fs/microsd/c\0/fs/microsd/log/b", b"/fs/microsd/c\0/fs/microsd/../../secret", b"//fs//microsd/./c"]
)  # fmt: skip


@given(
    requests=st.lists(
        st.tuples(
            st.integers(0, 20), st.integers(0, 3), st.integers(0, 0xFFFFFFFF) | st.integers(0, 300),
            NAMES | st.binary(max_size=239), st.integers(0, 255) | st.none(),
        ),
        max_size=8,
    )
)  # fmt: skip
@FUZZ
def test_any_requests_are_answered_and_stay_inside_the_folders(bench: Bench, root: Path, requests: list[Any]) -> None:
    files = Files(bench.client)
    for opcode, session, offset, data, size in requests:
        if opcode == ftp.BURST_READ:
            continue
        files.ask(opcode, data, session=session, offset=offset, size=size)
    bench.run(0.1)
    assert bench.autopilot.node.handler_errors == 0
    assert (root.parent / "secret").read_text() == "not yours"
    assert sorted(path.name for path in root.parent.iterdir()) == ["card", "log", "secret"]
    assert all(path.stat().st_size <= 64 << 20 for path in root.parent.rglob("*"))


@given(payload=st.binary(min_size=251, max_size=251))
@FUZZ
def test_no_payload_causes_a_handler_error(bench: Bench, payload: bytes) -> None:
    bench.client.send(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, list(payload)))
    bench.run(0.1)
    bench.client.forget()
    assert bench.autopilot.node.handler_errors == 0
