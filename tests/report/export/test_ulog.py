"""Reads ULog exports with pyulog."""

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from pyulog import ULog
from scipy.spatial.transform import Rotation

from dronecats.report.export import formats, layouts, ulog
from foundation.errors import UsageError


@pytest.fixture(scope="module", params=["alone", "fleet"])
def exported_log(request, tmp_path_factory):
    """Return (flight, its log as pyulog reads it)."""
    flight = request.getfixturevalue(request.param)
    path = tmp_path_factory.mktemp("ulog") / "flight.ulg"
    count = ulog.write(flight, path)
    log = ULog(str(path))
    assert sum(len(d.data["timestamp"]) for d in log.data_list) + len(log.logged_messages) == count
    assert not log.file_corruption
    return flight, log


def topic(log, name, drone=0):
    return log.get_dataset(name, drone).data


def test_tracks_are_exported_in_ned_with_the_vehicles_time(exported_log):
    flight, log = exported_log
    for drone in flight.drone_tracks:
        for suffix, track in (("", drone.estimate), ("_groundtruth", drone.truth)):
            place = topic(log, f"vehicle_local_position{suffix}", drone.number)
            assert list(place["timestamp"]) == [flight.t0_us + round(t * 1e6) for t in track.t_s]
            for k, (x, v) in enumerate((("x", "vx"), ("y", "vy"), ("z", "vz"))):
                np.testing.assert_allclose(place[x], track.position_ned[:, k], atol=1e-4)
                np.testing.assert_allclose(place[v], track.velocity_ned[:, k], atol=1e-5)
            turned = topic(log, f"vehicle_attitude{suffix}", drone.number)
            q = np.column_stack([turned[f"q[{k}]"] for k in (1, 2, 3, 0)])
            nose = Rotation.from_quat(q).apply([1.0, 0.0, 0.0])
            np.testing.assert_allclose(np.arctan2(nose[:, 1], nose[:, 0]), place["heading"], atol=1e-5)
            assert place["ref_lat"][0] == flight.origin[0]
            assert place["ref_lon"][0] == flight.origin[1]


def test_every_pose_of_the_logger_is_in_the_ground_truth(exported_log):
    flight, log = exported_log
    for pose in flight.logs.poses:
        place = topic(log, "vehicle_local_position_groundtruth", pose.drone)
        [at] = np.flatnonzero(place["timestamp"] == flight.t0_us + round(pose.t * 1e6))
        there = (place["x"][at], place["y"][at], place["z"][at])
        np.testing.assert_allclose(there, pose.position_ned, atol=1e-3)


def test_decisions_have_their_numbers_and_texts(exported_log):
    flight, log = exported_log
    for drone in flight.drone_tracks:
        mine = [s.decision for s in flight.steps if s.decision.drone == drone.number]
        topic_data = topic(log, "agent_decision", drone.number)
        assert list(topic_data["timestamp"]) == [flight.t0_us + round(d.t_decided * 1e6) for d in mine]
        assert list(topic_data["timestamp_frame"]) == [flight.t0_us + round(d.t_frame * 1e6) for d in mine]
        names = {1: "go", 2: "rotate", 3: "think", 4: "finished"}
        assert [names[a] for a in topic_data["action"]] == [d.kind for d in mine]
        for index, decision in enumerate(mine):
            depth_m = decision.action.get("depth_m", math.nan)
            np.testing.assert_allclose(topic_data["depth_m"][index], depth_m, rtol=1e-6)
        texts = [m.message for m in log.logged_messages if m.message.startswith(f"drone {drone.number + 1}, step ")]
        assert len(texts) == len(mine)


def test_topics_of_the_judge_have_marked_names(exported_log):
    flight, log = exported_log
    own = {"vehicle_local_position", "vehicle_attitude", "trajectory_setpoint", "agent_decision"}
    others = {d.name for d in log.data_list} - own
    assert all(name.startswith("judge_") or name.endswith("_groundtruth") for name in others)
    assert log.msg_info_dict["judge_outcome"] == flight.verdict.outcome
    target = topic(log, "judge_target")
    np.testing.assert_allclose(np.column_stack([target[k] for k in "xyz"]), flight.target_track.position_ned, atol=1e-4)
    declared = sum(len(d.data["step"]) for d in log.data_list if d.name == "judge_declaration")
    assert declared == len(flight.all_declarations)


def plotjuggler_names(log):
    """Return {PlotJuggler's name of a curve: its values}."""
    several = {d.name for d in log.data_list if d.multi_id > 0}
    return {
        f"{d.name}{f'.{d.multi_id:02}' * (d.name in several)}/" + re.sub(r"\[(\d+)\]", r".0\1", field): values
        for d in log.data_list
        for field, values in d.data.items()
    }


def test_the_layout_uses_existing_curves(exported_log, tmp_path):
    flight, log = exported_log
    drones = len(flight.drone_tracks)
    count = layouts.write(tmp_path / "plotjuggler-layout.xml", drones)
    root = ElementTree.parse(tmp_path / "plotjuggler-layout.xml").getroot()
    there = plotjuggler_names(log)
    curves = list(root.iter("curve"))
    assert len(curves) >= count == len(list(root.iter("plot"))) > 10
    for curve in curves:
        for name in [curve.get("curve_x"), curve.get("curve_y")] if "curve_x" in curve.attrib else [curve.get("name")]:
            assert name in there
            assert len(there[name])
    tabs = root.findall("tabbed_widget/Tab")
    for tab in tabs:
        [splitter] = tab.findall("Container/DockSplitter")
        plots = splitter.findall("DockArea/plot")
        assert int(str(splitter.get("count"))) == len(plots) == len(str(splitter.get("sizes")).split(";"))
        names = [curve.get("name") for curve in tab.iter("curve")]
        drawn = [name for name in names if "groundtruth" in str(name)]
        assert bool(drawn) == str(tab.get("tab_name")).startswith("judge: ")
        assert all(len(plot.findall("curve")) % drones == 0 for plot in plots)
        assert len(set(names)) == len(names)  # each drone has its own curves
    assert tabs[0].get("tab_name") == "path"


def test_layouts_are_written_next_to_their_logs(run, tmp_path):
    done = formats.export("ulog", [run], tmp_path)
    named = {"plotjuggler-layout.xml", "plotjuggler-layout-fleet.xml"}
    assert {path.name for path in done.files} == {f"{folder.name}.ulg" for folder in run.episodes} | named
    assert all(path.is_file() for path in done.files)
    (tmp_path / "residential-approaching-01.ulg").unlink()
    (tmp_path / "blocks-commanding-01.ulg").unlink()
    with pytest.raises(UsageError, match=r"plotjuggler-layout\.xml\b.*\b1\b.*--overwrite"):
        formats.export("ulog", [run], tmp_path)  # for example, a layout that the user edited
    assert layouts.layout_files("ulog", {4}) == {"plotjuggler-layout-fleet.xml": 4}
