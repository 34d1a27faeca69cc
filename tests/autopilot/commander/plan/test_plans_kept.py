"""Missions, fences and rally points survive a restart, as in PX4's dataman. A damaged file is an error."""

import json
import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot.commander.plans import Plans
from foundation.errors import UsageError
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench
from tests.autopilot.plan_client import ACCEPTED, PLANS, UNSUPPORTED, download, item, upload
from tests.support.refusal import refusal


def wire(bench: Bench, kind: int) -> list[bytes]:
    """Return a client's download, without the flag of the current item."""
    messages = download(bench.client, kind)
    for message in messages:
        message.current = 0
    return [message.pack(dialect.MAVLink(None), force_mavlink1=False)[10:-2] for message in messages]


def loaded(file: Path | None) -> Bench:
    bench = Bench(profile="minimal", plan_file=file)
    for kind, items in PLANS.items():
        assert upload(bench.client, items, kind) == ACCEPTED
    return bench


def test_a_new_process_serves_the_uploaded_plans_bit_for_bit(tmp_path: Path) -> None:
    file = tmp_path / "plans.json"
    before = loaded(file)
    after = Bench(profile="minimal", plan_file=file)
    for kind in PLANS:
        assert wire(after, kind) == wire(before, kind) != []
    assert json.loads(file.read_text())  # valid JSON
    assert "NaN" not in file.read_text()
    assert list(tmp_path.iterdir()) == [file]


def test_without_a_plan_file_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    loaded(None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("numbers", [(math.nan,) * 4, (math.inf, -math.inf, -0.0, 1e-45)])
def test_special_numbers_survive_a_restart(tmp_path: Path, numbers: tuple[float, ...]) -> None:
    file = tmp_path / "plans.json"
    bench = Bench(profile="minimal", plan_file=file)
    assert upload(bench.client, [item(0, p=numbers)]) == ACCEPTED
    assert wire(Bench(profile="minimal", plan_file=file), 0) == wire(bench, 0)


def test_extreme_coordinates_survive_a_restart(tmp_path: Path) -> None:
    file = tmp_path / "plans.json"
    bench = Bench(profile="minimal", plan_file=file)
    speed = item(0, dialect.MAV_CMD_DO_CHANGE_SPEED)
    speed.x = speed.y = -(1 << 31)  # NaN as an integer on x86
    assert upload(bench.client, [speed]) == ACCEPTED
    assert wire(Bench(profile="minimal", plan_file=file), 0) == wire(bench, 0)


def test_each_coordinate_of_a_place_is_checked() -> None:
    waypoint = item(0)
    waypoint.x, waypoint.y = (1 << 31) - 1, -(1 << 31)
    assert upload(Bench(profile="minimal").client, [waypoint]) == dialect.MAV_MISSION_INVALID_PARAM6_Y


def test_a_cleared_plan_stays_cleared_after_a_restart(tmp_path: Path) -> None:
    file = tmp_path / "plans.json"
    loaded(file).client.send(dialect.MAVLink_mission_clear_all_message(1, 1, dialect.MAV_MISSION_TYPE_FENCE))
    after = Bench(profile="minimal", plan_file=file)
    assert [len(download(after.client, kind)) for kind in (0, 1, 2)] == [4, 0, 1]


def test_the_current_mission_item_survives_a_restart(tmp_path: Path) -> None:
    file = tmp_path / "plans.json"
    loaded(file).client.send(dialect.MAVLink_mission_set_current_message(1, 1, 2))
    after = Bench(profile="minimal", plan_file=file)
    assert after.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_MISSION_CURRENT) == 0
    assert after.client.of("MISSION_CURRENT")[-1].seq == 2
    assert upload(after.client, PLANS[0][:2]) == ACCEPTED  # another mission begins at its first item
    assert Bench(profile="minimal", plan_file=file).commander.mission.current == 0


def test_a_finished_mission_restarts_at_its_first_item(tmp_path: Path) -> None:
    file = tmp_path / "plans.json"
    bench = Bench(profile="minimal", plan_file=file)
    assert upload(bench.client, [item(0, 22), item(1, north=60.0), item(2, 21)]) == ACCEPTED
    bench.autopilot.parameters.set("MPC_LAND_SPEED", 1.0)
    assert bench.client.command(dialect.MAV_CMD_MISSION_START, 0, 0) == 0
    bench.until(lambda: bench.height > 5.0, 30)
    bench.until(lambda: bench.commander.mission.current == 1, 30)
    assert Plans(file).current == 1
    bench.until(lambda: not bench.commander.armed, 90)
    assert Plans(file).current == 0
    assert len(Plans(file).mission) == 3


def test_a_failed_write_to_disk_does_not_reject_the_plan(tmp_path: Path) -> None:
    bench = Bench(profile="minimal", plan_file=tmp_path / "gone" / "plans.json")
    assert upload(bench.client, PLANS[0]) == ACCEPTED
    assert bench.commander.flight.plans.unsaved
    assert any(text.startswith("Plans not saved: ") for text in bench.client.texts())
    assert len(download(bench.client)) == 4


def test_a_damaged_file_is_rejected_by_name_and_left_unchanged(tmp_path: Path) -> None:
    for content in [
        "", "[]", '{"mission": 3}', '{"mission": [{}]}', '{"mission": [{"command": 16}]}', '{"current": "two"}',
        '{"fence": [{"command": 5001, "frame": 5, "p": [3, 0, 0, 0], "x": 1, "y": 1, "z": 0, "autocontinue": 1}]}',
    ]:  # fmt: skip
        file = tmp_path / "plans.json"
        file.write_text(content)
        assert "plans.json" in refusal(Plans, file), content
        assert file.read_text() == content, content  # unchanged, for manual repair


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.data())
def test_any_damaged_file_is_rejected_or_gives_a_usable_plan(tmp_path: Path, data: st.DataObject) -> None:
    file = tmp_path / "plans.json"
    if not (tmp_path / "whole").exists():
        loaded(tmp_path / "whole")
    text = bytearray((tmp_path / "whole").read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
    file.write_bytes(text)
    try:
        plans = Plans(file)
    except UsageError:
        return
    bench = Bench(profile="minimal")
    bench.commander.flight.plans = plans
    bench.run(0.1)
    bench.client.arm()
    bench.commander.set_mode("MISSION")
    bench.run(0.5)
    assert bench.autopilot.node.handler_errors == 0
    for kind in PLANS:
        assert len(download(bench.client, kind)) == len(plans.items[kind])


def test_a_partial_write_is_rejected_at_once_and_changes_nothing() -> None:
    bench = loaded(None)
    bench.run(6.0)  # until a repeated last item of the upload is no longer expected
    before = wire(bench, 0)
    bench.client.forget()
    bench.client.send(dialect.MAVLink_mission_write_partial_list_message(1, 1, 1, 2, 0))
    assert [(ack.type, ack.mission_type) for ack in bench.client.of("MISSION_ACK")] == [(UNSUPPORTED, 0)]
    bench.client.send(item(1, north=400.0))
    assert bench.client.of("MISSION_ACK")[-1].type != ACCEPTED  # an unrequested item is rejected too
    assert wire(bench, 0) == before
