"""The parameter protocol, integers with byte-wise encoding, and persistence."""

import json
import math
import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot.parameters import DEFAULTS, ParameterTable
from foundation.mavlink import Packer, dialect
from tests.autopilot.commander_bench import Bench, Client
from tests.support.refusal import refusal

INT32, REAL32 = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench(profile="minimal")


def as_float(value: int) -> float:
    return float(struct.unpack("<f", struct.pack("<i", value))[0])


def number(message: dialect.MAVLink_message) -> float:
    """Return the value as a client with byte-wise integers reads it."""
    frame = bytes(message.get_msgbuf())
    raw = frame[10 : 10 + min(frame[1], 4)].ljust(4, b"\0")
    return struct.unpack("<i" if message.param_type == INT32 else "<f", raw)[0]  # type: ignore[no-any-return]


class IntegerSet(dialect.MAVLink_param_set_message):  # type: ignore[misc]
    """PARAM_SET with the integer's own bytes, as C clients send it."""

    def __init__(self, name: bytes, value: int) -> None:
        super().__init__(1, 1, name, 0.0, INT32)
        self.integer = value

    def pack(self, mav: object, force_mavlink1: bool = False) -> bytes:
        payload = struct.pack("<iBB16sB", self.integer, 1, 1, self._param_id_raw.ljust(16, b"\0"), INT32)
        return bytes(self._pack(mav, self.crc_extra, payload))


def test_the_parameter_list_is_complete_and_has_no_gaps(bench: Bench) -> None:
    client = bench.client
    client.forget()
    client.send(dialect.MAVLink_param_request_list_message(1, 1))
    bench.run(1.0)
    values = client.of("PARAM_VALUE")
    assert [v.param_index for v in values] == list(range(values[0].param_count))
    names = [v.param_id for v in values]
    assert set(names) >= set(DEFAULTS)
    assert all(len(name) <= 16 for name in names)
    for v in values:
        expected = bench.autopilot.parameters[v.param_id]
        assert number(v) == expected, v.param_id
        assert (v.param_type == INT32) == isinstance(expected, int)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
@given(value=st.integers(-(1 << 31), (1 << 31) - 1))
def test_every_integer_is_set_and_read_back_exactly(bench: Bench, value: int) -> None:
    bench.client.forget()
    bench.client.send(IntegerSet(b"SYS_AUTOSTART", value))
    assert number(bench.client.of("PARAM_VALUE")[-1]) == value
    assert bench.autopilot.parameters["SYS_AUTOSTART"] == value


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
@given(value=st.floats(width=32))
def test_finite_floats_are_stored_exactly_and_others_are_rejected(bench: Bench, value: float) -> None:
    before = bench.autopilot.parameters["RTL_RETURN_ALT"]
    bench.client.forget()
    bench.client.set_parameter("RTL_RETURN_ALT", value, REAL32)
    if math.isfinite(value):
        assert number(bench.client.of("PARAM_VALUE")[-1]) == value
    else:
        assert bench.client.of("PARAM_ERROR")[-1].error == dialect.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
        assert bench.autopilot.parameters["RTL_RETURN_ALT"] == before


def test_a_parameter_is_read_by_name_and_by_index(bench: Bench) -> None:
    client, parameters = bench.client, bench.autopilot.parameters
    client.send(dialect.MAVLink_param_request_read_message(1, 1, b"MIS_TAKEOFF_ALT", -1))
    by_name = client.of("PARAM_VALUE")[-1]
    assert by_name.param_id == "MIS_TAKEOFF_ALT"
    client.send(dialect.MAVLink_param_request_read_message(1, 1, b"", by_name.param_index))
    assert client.of("PARAM_VALUE")[-1].param_id == parameters.names[by_name.param_index]


def test_unknown_names_get_a_param_error(bench: Bench) -> None:
    client = bench.client
    client.forget()
    client.send(dialect.MAVLink_param_request_read_message(1, 1, b"NO_SUCH_THING", -1))
    client.send(dialect.MAVLink_param_request_read_message(1, 1, b"", 30000))
    client.set_parameter("NO_SUCH_THING", 1.0, REAL32)
    errors = client.of("PARAM_ERROR")
    assert [e.error for e in errors] == [dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST] * 3
    assert errors[0].param_id == "NO_SUCH_THING"
    assert not client.of("PARAM_VALUE")


def test_a_wrong_type_changes_nothing(bench: Bench) -> None:
    bench.autopilot.parameters.set("COM_RCL_EXCEPT", 0)
    bench.client.forget()
    bench.client.set_parameter("COM_RCL_EXCEPT", 4.0, REAL32)
    assert number(bench.client.of("PARAM_VALUE")[-1]) == 0
    bench.client.set_parameter("COM_RCL_EXCEPT", as_float(4), INT32)
    assert number(bench.client.of("PARAM_VALUE")[-1]) == 4


def test_changes_reach_every_client_and_the_core(bench: Bench) -> None:
    second = Client(bench.autopilot.open_port("minimal"), 255, 190)
    bench.client.set_parameter("MPC_XY_P", 1.25, REAL32)
    assert second.of("PARAM_VALUE")[-1].param_value == 1.25
    assert bench.core.parameter_changes[-1] == ("MPC_XY_P", 1.25)
    change_count = len(bench.core.parameter_changes)
    bench.client.set_parameter("MPC_XY_P", 1.25, REAL32)  # same value, so no change
    bench.client.set_parameter("RTL_RETURN_ALT", 21.0, REAL32)  # not a parameter of the core
    assert len(bench.core.parameter_changes) == change_count
    bench.autopilot.close_port(second.port)


def test_values_are_restored_from_the_file(tmp_path: Path) -> None:
    file = tmp_path / "parameters.json"
    first = ParameterTable({"MPC_XY_P": 0.95}, None, file)
    first.set("COM_OBL_RC_ACT", 5)
    first.set("MPC_XY_P", 1.5)
    changes: list[tuple[str, float]] = []
    second = ParameterTable({"MPC_XY_P": 0.95}, lambda name, value: changes.append((name, value)), file)
    assert (second["COM_OBL_RC_ACT"], second["MPC_XY_P"]) == (5, 1.5)
    assert changes == [("MPC_XY_P", 1.5)]
    assert json.loads(file.read_text()) == {"COM_OBL_RC_ACT": 5, "MPC_XY_P": 1.5}
    second.reset()
    assert json.loads(file.read_text()) == {}
    assert list(tmp_path.iterdir()) == [file]


def test_the_error_for_a_broken_file_names_the_file(tmp_path: Path) -> None:
    for content in ["", "[1]", '{"MPC_XY_P": "x"}', '{"MPC_XY_P": null}', "\x00"]:
        file = tmp_path / "parameters.json"
        file.write_text(content)
        assert "parameters.json" in refusal(ParameterTable, {}, None, file), content


def test_requests_to_other_targets_are_ignored(bench: Bench) -> None:
    bench.client.forget()
    for target in ((2, 1), (1, 100)):
        message = dialect.MAVLink_param_request_read_message(*target, b"MPC_XY_P", -1)
        bench.client.port.receive(Packer(245, 190).pack(message))
    assert not bench.client.of("PARAM_VALUE")
