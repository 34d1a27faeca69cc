"""A strict ULog reader checks every byte of a flight log.

The reader is written from the specification alone (docs.px4.io, ULog File Format). It checks every offset and size, so
that readers that cast memory (PlotJuggler) get the same values as pyulog, which tolerates errors.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyulog import ULog

from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle, Simulation
from dronecats.flight.stages.lockstep import Lockstep
from hil.link.link import Link
from vehicles import airframe

SIZES = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I", "int64_t": "q",
    "uint64_t": "Q", "float": "f", "double": "d", "bool": "B", "char": "c",
}  # fmt: skip
NAME = re.compile(r"[a-zA-Z][a-zA-Z0-9_]*")
TYPE = re.compile(r"([a-zA-Z][a-zA-Z0-9_]*)(?:\[([1-9][0-9]*)\])?")
DEFINITIONS, DATA = set("BFIMPQA"), set("ADRLCSOIMPQ")


@dataclass
class Read:
    """The contents of a log file, as parsed by the strict reader."""

    start_us: int
    formats: dict[str, list[tuple[str, int, str]]] = field(default_factory=dict)  # name → (type, count, field)
    topics: dict[int, str] = field(default_factory=dict)  # msg_id → format
    parameters: dict[str, float] = field(default_factory=dict)
    samples: dict[str, list[tuple[Any, ...]]] = field(default_factory=dict)
    stamps: list[int] = field(default_factory=list)  # of data and texts, in the order of the file


def layout(read: Read, name: str, depth: int = 0) -> tuple[str, list[str]]:
    """Return the packed struct codes of a format and its fields' flat names. Nested formats keep their timestamps."""
    assert depth < 5, f"{name} contains itself"
    codes = ""
    names: list[str] = []
    for kind, count, label in read.formats[name]:
        for i in range(count):
            own = f"{label}[{i}]" if count > 1 else label
            if kind in SIZES:
                codes, names = codes + SIZES[kind], [*names, own]
            else:
                inner, labels = layout(read, kind, depth + 1)
                codes, names = codes + inner, [*names, *(f"{own}.{each}" for each in labels)]
    return codes, names


def format_of(text: str) -> tuple[str, list[tuple[str, int, str]]]:
    """Return a format message's name and fields."""
    name, body = text.split(":")
    assert re.fullmatch(r"[a-zA-Z0-9_\-/]+", name)
    assert body.endswith(";")
    fields = []
    for entry in body[:-1].split(";"):
        kind, label = entry.split(" ")
        match = TYPE.fullmatch(kind)
        assert match, entry
        assert NAME.fullmatch(label) or re.fullmatch(r"_padding\d+", label), entry
        fields.append((match[1], int(match[2] or 1), label))
    assert fields[0] == ("uint64_t", 1, "timestamp"), "readers that cast look for the time at the first byte"
    assert len({label for _, _, label in fields}) == len(fields)
    padding = [i for i, (_, _, label) in enumerate(fields) if label.startswith("_padding")]
    assert all(i < len(fields) - 1 for i in padding), "padding at the end is not logged"
    return name, fields


def keyed(payload: bytes) -> tuple[str, str, bytes]:
    """Return type, name and value of an information or a parameter message."""
    length = payload[0]
    kind, name = payload[1 : 1 + length].decode("ascii").split(" ")
    value = payload[1 + length :]
    match = TYPE.fullmatch(kind)
    assert match
    assert len(value) == struct.calcsize("<" + SIZES[match[1]]) * int(match[2] or 1), name
    return match[1], name, value


def messages(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield (type, payload) of every message from the end of the header to the end of the file."""
    at = 16
    while at < len(data):
        size, kind = struct.unpack_from("<HB", data, at)
        assert at + 3 + size <= len(data), "the last message is cut"
        yield chr(kind), data[at + 3 : at + 3 + size]
        at += 3 + size


def strictly(data: bytes) -> Read:
    """Read a whole log; every deviation from the specification is an AssertionError."""
    assert data[:7] == bytes.fromhex("554c6f67011235")
    version, start_us = struct.unpack_from("<BQ", data, 7)
    assert version in (0, 1)
    read, defining = Read(start_us), True
    for number, (kind, payload) in enumerate(messages(data)):
        defining = defining and kind not in "ADLCSO"  # the first subscription ends the definitions
        assert kind in (DEFINITIONS if defining else DATA), f"{kind} in the wrong section"
        if kind == "B":
            assert number == 0
            assert len(payload) == 40
            compatible, incompatible = payload[:8], payload[8:16]
            assert not any(incompatible)
            assert not any(compatible[1:])
            assert struct.unpack("<3Q", payload[16:]) == (0, 0, 0)  # nothing appended
        elif kind == "F":
            name, fields = format_of(payload.decode("ascii"))
            assert name not in read.formats
            read.formats[name] = fields
        elif kind == "I":
            keyed(payload)
        elif kind == "P":
            form, name, value = keyed(payload)
            assert form in ("int32_t", "float")
            read.parameters[name] = struct.unpack("<i" if form == "int32_t" else "<f", value)[0]
        elif kind == "A":
            instance, topic = struct.unpack_from("<BH", payload)
            assert instance == 0
            assert topic not in read.topics, "an identifier stands for one topic"
            assert payload[3:].decode("ascii") in read.formats
            assert payload[3:].decode("ascii") not in read.topics.values(), "a second one would need an instance"
            read.topics[topic] = payload[3:].decode("ascii")
        elif kind == "D":
            (topic,) = struct.unpack_from("<H", payload)
            name = read.topics[topic]
            codes, _ = layout(read, name)
            values = struct.unpack("<" + codes, payload[2:])  # raises unless the size is exact
            for code, value in zip(codes, values, strict=True):
                assert code != "B" or 0 <= value <= 255
            read.samples.setdefault(name, []).append(values)
            read.stamps.append(values[0])
        elif kind == "L":
            level, stamp = struct.unpack_from("<BQ", payload)
            assert ord("0") <= level <= ord("7")
            payload[9:].decode("ascii")
            read.stamps.append(stamp)
    return read


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """The log of a flight of the complete simulated vehicle: arming, take-off, hold, landing, disarming."""
    folder: Path = tmp_path_factory.mktemp("log")
    vehicle = SimulatedVehicle(
        0, airframe.load("x500"), BootPose((0.0, 0.0, 0.0), 0.0), seed=5, origin=(47.4, 8.5, 488.0), state_dir=folder
    )
    link = Link(Lockstep(Simulation([vehicle])).transport(0))
    link.connect()
    link.wait_for(lambda state: state.healthy, 60.0, "getting ready")
    link.arm()
    link.set_mode("TAKEOFF")
    link.wait(8.0)
    link.set_mode("LAND")
    link.wait_for(lambda state: state.armed is False, 60.0, "landing")
    vehicle.close()
    (path,) = folder.rglob("*.ulg")
    return path


def test_log_follows_the_ulog_specification(log: Path) -> None:
    read = strictly(log.read_bytes())
    assert len(read.topics) == len(read.formats) > 15
    assert len(read.samples) == len(read.formats)  # every topic of the table has rows in a flight
    assert len(read.parameters) > 100


def test_timestamps_increase_in_every_topic_and_through_the_file(log: Path) -> None:
    read = strictly(log.read_bytes())
    for name, samples in read.samples.items():
        stamps = np.array([sample[0] for sample in samples], np.int64)
        assert (np.diff(stamps) > 0).all(), name
    assert read.stamps == sorted(read.stamps)
    assert read.start_us <= read.stamps[0]


def test_sample_time_is_not_after_the_message_time(log: Path) -> None:
    read = strictly(log.read_bytes())
    checked = 0
    for name, samples in read.samples.items():
        _, names = layout(read, name)
        if "timestamp_sample" in names:
            at = names.index("timestamp_sample")
            assert all(sample[at] <= sample[0] < sample[at] + 1_000_000 for sample in samples), name
            checked += 1
    assert checked > 5


def test_flags_are_zero_or_one(log: Path) -> None:
    read = strictly(log.read_bytes())
    for name, samples in read.samples.items():
        kinds = [kind for kind, count, _ in read.formats[name] for _ in range(count)]
        for i in (i for i, kind in enumerate(kinds) if kind == "bool"):
            assert {sample[i] for sample in samples} <= {0, 1}, name


def test_pyulog_reads_the_same_numbers(log: Path) -> None:
    read, other = strictly(log.read_bytes()), ULog(str(log))
    assert not other.file_corruption
    assert {each.name for each in other.data_list} == set(read.samples)
    for each in other.data_list:
        _, names = layout(read, each.name)
        for name, column in zip(names, zip(*read.samples[each.name], strict=True), strict=True):
            np.testing.assert_array_equal(
                np.array(column, each.data[name].dtype), each.data[name], f"{each.name}.{name}"
            )
    assert other.start_timestamp == read.start_us or other.start_timestamp == read.stamps[0]


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[:-1],  # a cut message
        lambda data: data + b"\x01\x00D\x00",  # a sample shorter than its identifier
        lambda data: data.replace(b"uint64_t timestamp;", b"uint64_t timestanp;", 1),
        lambda data: data.replace(b"float[4] q;", b"float[5] q;", 1),
        lambda data: data.replace(b"vehicle_attitude:", b"vehicle_attitudi:", 1),
    ],
)
def test_the_strict_reader_rejects_damaged_logs(log: Path, damage) -> None:
    with pytest.raises((AssertionError, KeyError, struct.error)):
        strictly(damage(log.read_bytes()))


def test_the_strict_reader_follows_nested_formats() -> None:
    read = Read(0)
    for text in (
        "inner:uint64_t timestamp;float[2] v;uint8_t _padding0;uint8_t n;",
        "outer:uint64_t timestamp;inner[2] i;",
    ):
        name, fields = format_of(text)
        read.formats[name] = fields
    codes, names = layout(read, "outer")
    assert codes == "Q" + 2 * "QffBB"
    assert names[-1] == "i[1].n"
