"""Parameters survive a restart. A kill at any moment leaves a complete file."""

import json
import os
import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot.parameters import DEFAULTS, ParameterTable
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench
from tests.support.refusal import refusal

INT32, REAL32 = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32


def test_parameters_set_by_a_client_survive_a_restart(tmp_path: Path) -> None:
    file = tmp_path / "parameters.json"
    bench = Bench(profile="minimal", parameter_file=file)
    bench.client.set_parameter("MIS_TAKEOFF_ALT", 12.5, REAL32)
    bench.client.set_parameter("MC_ROLLRATE_P", 0.25, REAL32)
    integer = struct.unpack("<f", struct.pack("<i", 4))[0]
    bench.client.set_parameter("COM_RCL_EXCEPT", integer, INT32)
    again = Bench(profile="minimal", parameter_file=file)
    parameters = again.autopilot.parameters
    assert [parameters[n] for n in ("MIS_TAKEOFF_ALT", "MC_ROLLRATE_P", "COM_RCL_EXCEPT")] == [12.5, 0.25, 4]
    assert ("MC_ROLLRATE_P", 0.25) in again.core.parameter_changes  # the inner loop receives it as well
    parameters.reset()
    assert ParameterTable(file=file)["MIS_TAKEOFF_ALT"] == DEFAULTS["MIS_TAKEOFF_ALT"]


@given(values=st.dictionaries(st.sampled_from(sorted(DEFAULTS)), st.integers(-1000, 1000), max_size=20))
@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_changes_are_restored_from_the_file(tmp_path: Path, values: dict[str, int]) -> None:
    file = tmp_path / "parameters.json"
    file.unlink(missing_ok=True)
    parameters = ParameterTable(file=file)
    for name, value in values.items():
        parameters.set(name, value)
    again = ParameterTable(file=file)
    assert {name: again[name] for name in again.names} == {name: parameters[name] for name in parameters.names}


def test_a_kill_while_writing_keeps_the_previous_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "parameters.json"
    parameters = ParameterTable(file=file)
    parameters.set("MIS_TAKEOFF_ALT", 7.0)

    class Killed(BaseException):
        pass

    def kill(*_: object) -> None:
        raise Killed

    monkeypatch.setattr(os, "replace", kill)
    with pytest.raises(Killed):
        parameters.set("MIS_TAKEOFF_ALT", 8.0)
    monkeypatch.undo()
    assert ParameterTable(file=file)["MIS_TAKEOFF_ALT"] == 7.0


def test_loading_does_not_modify_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "parameters.json"
    file.write_text(json.dumps({"MIS_TAKEOFF_ALT": 7.0, "RTL_RETURN_ALT": 20.0, "GONE_SINCE": 1}))
    before = file.read_bytes()
    assert ParameterTable(file=file)["RTL_RETURN_ALT"] == 20.0
    assert file.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["parameters.json"]


def test_an_invalid_file_is_rejected(tmp_path: Path) -> None:
    for text in (
        "", "[]", "{", '{"MIS_TAKEOFF_ALT": "high"}', '{"MIS_TAKEOFF_ALT": NaN}', '{"COM_RCL_EXCEPT": 1e12}', "\0",
    ):  # fmt: skip
        file = tmp_path / "parameters.json"
        file.write_text(text)
        assert "parameters.json" in refusal(ParameterTable, file=file), text


def test_a_write_error_is_reported_and_the_parameter_is_still_set(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    bench = Bench(profile="minimal", parameter_file=folder / "parameters.json")
    folder.rmdir()
    bench.client.set_parameter("MIS_TAKEOFF_ALT", 9.0, REAL32)
    assert bench.client.of("PARAM_VALUE")[-1].param_value == 9.0
    assert any("saved" in text for text in bench.client.texts())
    folder.mkdir()
    bench.client.set_parameter("MIS_TAKEOFF_ALT", 10.0, REAL32)
    assert bench.autopilot.parameters.unsaved is None
    assert ParameterTable(file=folder / "parameters.json")["MIS_TAKEOFF_ALT"] == 10.0
