"""Files that grow while they are read: each entry comes exactly once, and no incomplete row is read."""

import itertools
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from dronecats.view.live.folder import FrameTail, LineTail, is_intact
from foundation.mavlink import Packer, dialect
from foundation.run_folder.writing import TelemetryLog


def frames(count: int) -> list[bytes]:
    """Return frames of several lengths. Every third is a text message."""
    packer = Packer(1, 1)
    made = []
    for k in range(count):
        text = dialect.MAVLink_statustext_message(6, b"x" * (k % 50), 0, 0)
        place = dialect.MAVLink_local_position_ned_message(1000 + k, 0.5 * k, -k, 0.1, 0, 0, 0)
        made.append(packer.pack(text if k % 3 == 0 else place))
    return made


def tlog(path, count: int = 24) -> tuple[bytes, list[tuple[int, bytes]]]:
    log, written = TelemetryLog(path), []
    for k, frame in enumerate(frames(count)):
        log.write(1_000_000 + 20_000 * k, frame)
        written.append((1_000_000 + 20_000 * k, frame))
    log.close()
    return path.read_bytes(), written


def read_in_pieces(path, tail, data: bytes, cuts: list[int]) -> list[Any]:
    """Write a file in pieces, read its tail after each piece, and return all entries."""
    entries = []
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    with path.open("wb") as file:
        for low, high in itertools.pairwise(edges):
            file.write(data[low:high])
            file.flush()
            entries += tail.read()
    return entries


@given(cuts=st.lists(st.integers(0, 2000), max_size=12))
def test_a_tlog_cut_anywhere_gives_each_frame_once(tmp_path_factory, cuts):
    folder = tmp_path_factory.mktemp("tlog")
    data, written = tlog(folder / "whole")
    assert read_in_pieces(folder / "grows", FrameTail(folder / "grows"), data, cuts) == written


LINE = st.binary(max_size=40).filter(lambda line: b"\n" not in line)


@given(lines=st.lists(LINE, max_size=8), cuts=st.lists(st.integers(0, 400), max_size=8), torn=LINE)
def test_a_log_cut_anywhere_gives_each_line_once_and_no_partial_line(tmp_path_factory, lines, cuts, torn):
    folder = tmp_path_factory.mktemp("lines")
    data = b"".join(line + b"\n" for line in lines) + torn
    assert read_in_pieces(folder / "log", LineTail(folder / "log"), data, cuts) == lines


@given(
    noise=st.binary(min_size=1, max_size=120), after=st.integers(0, 23), cuts=st.lists(st.integers(0, 2000), max_size=6)
)
def test_the_tail_resynchronizes_after_invalid_bytes(tmp_path_factory, noise, after, cuts):
    """Invalid bytes, as after a kill, cost the frames around them. The tail reads the frames that follow."""
    folder = tmp_path_factory.mktemp("noise")
    _, written = tlog(folder / "whole", 60)
    packed = [time_us.to_bytes(8, "big") + frame for time_us, frame in written]
    data = b"".join(packed[:after]) + noise + b"".join(packed[after:])
    entries = read_in_pieces(folder / "grows", FrameTail(folder / "grows"), data, cuts)
    good = [entry for entry in entries if is_intact(entry[1]) and entry in written]
    assert good[:after] == written[:after]
    assert written[-10:] == good[-10:]


def test_bytes_that_look_like_a_frame_header_hide_no_frame(tmp_path):
    """The bytes are a time, a start marker and a length that spans the next six frames."""
    _, written = tlog(tmp_path / "whole", 12)
    packed = [time_us.to_bytes(8, "big") + frame for time_us, frame in written]
    noise = b"\xff" * 9 + bytes(8) + b"\xfd\xff\x00"
    (tmp_path / "torn").write_bytes(noise + b"".join(packed))
    assert FrameTail(tmp_path / "torn").read() == written


def test_a_missing_file_reads_as_empty_until_it_exists(tmp_path):
    tail = LineTail(tmp_path / "late")
    assert tail.read() == []
    (tmp_path / "late").write_bytes(b"one\ntw")
    assert tail.read() == [b"one"]
    assert tail.read() == []


def test_a_damaged_frame_is_not_intact():
    (frame,) = frames(1)
    assert is_intact(frame)
    assert not is_intact(frame[:-3] + b"\0\0\0")
    assert not is_intact(b"\xfd\x00")
