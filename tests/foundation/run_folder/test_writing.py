"""The exact bytes of the log files. All readers of the logs depend on them."""

import json
import struct
from typing import Any, cast

from foundation.run_folder.layout import frame_name, intent_name
from foundation.run_folder.results import Diagnostics, DroneDiagnostics
from foundation.run_folder.rows import Begin, Decision, End, Pose
from foundation.run_folder.writing import LineLog, TelemetryLog, as_json, write_lines

POSE = Pose(t=0.5, drone=1, position_ned=(1.0, 2.0, -3.0), yaw_deg=90.0, distance_m=4.0, visible=None)


def test_rows_are_written_in_order_and_immediately(tmp_path):
    path = tmp_path / "log"
    log = LineLog(path)
    for row in (Begin(t0_us=7, cap_s=300.0), POSE, End(t=1.0, reason="error", error="½")):
        log.write(row)
        assert path.read_bytes().endswith(b"}\n")  # before the log is closed
    log.close()
    log = LineLog(path)
    log.write(Begin(t0_us=8, source="estimate"))
    log.close()
    assert path.read_text().splitlines() == [
        '{"kind": "begin", "t": 0.0, "t0_us": 7, "cap_s": 300.0}',
        '{"kind": "pose", "t": 0.5, "drone": 1, "position_ned": [1.0, 2.0, -3.0], "yaw_deg": 90.0, "target_ned": null,'
        ' "distance_m": 4.0, "visible": null}',
        '{"kind": "end", "t": 1.0, "reason": "error", "error": "\\u00bd"}',
        '{"kind": "begin", "t": 0.0, "t0_us": 8, "cap_s": null, "source": "estimate"}',
    ]


def test_a_decision_is_written_with_all_its_fields(tmp_path):
    action = {"action": "go", "point": [1, 2.0], "depth_m": 3.0}
    row = Decision(step=0, drone=0, frame_id=4, t_frame=1.0, t_decided=1.5, reply="\ud800", action=action,
                   latency_s=0.5, tokens_in=10, thinking=False)  # fmt: skip
    write_lines(tmp_path / "log", [row])
    assert (tmp_path / "log").read_text() == (
        '{"step": 0, "drone": 0, "frame_id": 4, "t_frame": 1.0, "t_decided": 1.5, "reply": "\\ud800",'
        ' "action": {"action": "go", "point": [1, 2.0], "depth_m": 3.0}, "error": null, "latency_s": 0.5,'
        ' "tokens_in": 10, "tokens_out": null, "thinking": false, "rate_hz": null}\n'
    )
    assert not (tmp_path / "log.part").exists()


def test_the_own_fields_of_a_subclass_precede_the_inherited_fields():
    names = [*Diagnostics.__dataclass_fields__]
    row = as_json(DroneDiagnostics(drone=1, declarations=2, qualifying=0, **dict.fromkeys(names, cast(Any, 1.0))))
    assert [*row] == ["drone", "declarations", "qualifying", *names]
    assert json.loads(json.dumps(row)) == row


def test_a_tlog_stores_each_frame_after_its_timestamp(tmp_path):
    log = TelemetryLog(tmp_path / "flight.tlog")
    log.write(2**40, b"\xfdabc")
    log.close()
    assert (tmp_path / "flight.tlog").read_bytes() == struct.pack(">Q", 2**40) + b"\xfdabc"


def test_image_names_contain_frame_and_drone_numbers():
    assert [frame_name(7), frame_name(7, 0), frame_name(1234567, 3)] == ["000007.jpg", "000007.jpg", "1234567_d3.jpg"]
    assert [intent_name(7), intent_name(7, 2)] == ["0007.jpg", "0007_d2.jpg"]
