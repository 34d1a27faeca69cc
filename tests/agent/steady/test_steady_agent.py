"""The steady agent with an ideal vehicle: the times of its questions, the motion in between, and the log."""

import itertools
import json
import math

import numpy as np
import pytest

from dronecats.agent.action import Go, Rotate
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.loop import Questions
from dronecats.agent.models.model import Reply
from dronecats.agent.prompt import Prompt
from dronecats.agent.steady.agent import SteadyAgent, SteadyDrone
from dronecats.agent.steady.leg import seen_place
from foundation.camera import CameraModel, Frame
from foundation.run_folder.writing import LineLog
from foundation.threads import InlineExecutor
from hil.link.course import PoseHistory
from hil.link.offboard import GRACE_US, OffboardStream, PositionSetpoint
from tests.support.charged import Charged

CAMERA = CameraModel(width=64, height=36)
TICK_US = 50_000


class Follows:
    """A vehicle without inertia. It uses the production offboard stream and pose history."""

    def __init__(self):
        self.time_us, self.position, self.yaw = 0, (0.0, 0.0, -2.0), 0.0
        self.speeds: list[float] = []  # m/s, at each tick
        self._stream, self._track = OffboardStream(), PoseHistory()
        self._tell(0.0)

    def _tell(self, rate):
        self._track.place(self.time_us, self.position, (0.0, 0.0, 0.0))
        self._track.heading(self.time_us, self.yaw, rate)
        self._rate = rate

    @property
    def steady(self):
        return self._stream.steady(self.position, self.yaw, self._rate)

    def sight(self, time_us):
        return self._track.at(time_us)

    def fly(self, setpoint, seconds=None, seen=None):
        ends_us = None if seconds is None else self.time_us + round(seconds * 1e6)
        self._stream.fly(setpoint, ends_us, self.time_us, seen)

    def listen(self):
        pass

    def tick(self):
        setpoint = self._stream.streamed(self.position, (0.0, 0.0, 0.0), self.yaw, self.time_us)
        rate = speed = 0.0
        if isinstance(setpoint, PositionSetpoint):
            self.yaw = setpoint.yaw
        elif setpoint is not None:
            forward, right, down = setpoint.velocity_body
            north = math.cos(self.yaw) * forward - math.sin(self.yaw) * right
            east = math.sin(self.yaw) * forward + math.cos(self.yaw) * right
            step, (x, y, z) = TICK_US / 1e6, self.position
            self.position = (x + north * step, y + east * step, z + down * step)
            rate, speed = setpoint.yaw_rate, math.hypot(forward, right, down)
            self.yaw += rate * TICK_US / 1e6
        self.speeds.append(speed)
        self.time_us += TICK_US
        self._tell(rate)


class Views:
    """Takes frames at the time of the request and records the vehicle's pose at that time."""

    def __init__(self, aircraft):
        self._aircraft, self.taken = aircraft, []

    def newest(self, drone=0):
        vehicle = self._aircraft[drone]
        self.taken.append((vehicle.time_us / 1e6, vehicle.position, vehicle.yaw))
        return Frame(len(self.taken) - 1, drone, vehicle.time_us, np.zeros((36, 64, 3), np.uint8))

    def close(self):
        pass


class Says:
    """A model that gives these replies in order and repeats the last."""

    name = "says"

    def __init__(self, *replies):
        self._replies, self.asked = replies, 0

    def ask(self, request):
        reply = self._replies[min(self.asked, len(self._replies) - 1)]
        self.asked += 1
        several = len(request.images_jpeg) > 1
        return Reply(json.dumps([reply] * len(request.images_jpeg) if several else reply), 0.0)

    def check(self):
        pass

    def close(self):
        pass


GO = {"action": "go", "point": [500, 500], "depth_m": 40.0}
CAREFUL = {"action": "go", "point": [500, 500], "depth_m": 2.5}
TURN = {"action": "rotate", "angle_deg": 60}
THINK, FINISHED = {"action": "think"}, {"action": "finished"}


def fly_steady(folder, model, policy, seconds=20.0, drones=1, groups=None):
    """Return (decisions, aircraft, camera)."""
    aircraft = [Follows() for _ in range(drones)]
    camera, log = Views(aircraft), LineLog(folder / "decisions.jsonl")
    cockpit = Cockpit(
        aircraft=aircraft, camera=camera, camera_model=CAMERA, log=log, frames_dir=folder,
        executor=InlineExecutor(), t0_us=0,
    )  # fmt: skip
    SteadyAgent(Questions(model, Prompt.load(None), "go", policy), cockpit, groups).fly(seconds)
    log.close()
    return [json.loads(line) for line in (folder / "decisions.jsonl").read_text().splitlines()], aircraft, camera


@pytest.mark.parametrize("slow_s", [0.5, 2.0, 4.0, 8.0])
def test_a_go_does_not_stop_once_reply_times_are_estimated(tmp_path, slow_s):
    decisions, (vehicle,), _ = fly_steady(
        tmp_path, Says(GO), LatencyPolicy.parse(f"fixed:{slow_s}"), seconds=20.0 * max(2.5, slow_s)
    )
    assert decisions[0]["t_decided"] == pytest.approx(slow_s, abs=0.06)
    assert min(vehicle.speeds[round(slow_s * 20) + 3 :]) > 0.2  # the second image waits for the first stride
    known_tick = round(decisions[6]["t_decided"] * 20)
    assert min(vehicle.speeds[known_tick:]) > 1.1
    for before, after in itertools.pairwise(decisions[6:]):
        assert after["t_decided"] - before["t_decided"] == pytest.approx(max(2.5, slow_s), abs=0.16)
        assert after["t_decided"] - after["t_frame"] == pytest.approx(slow_s, abs=0.06)


@pytest.mark.parametrize("slow_s", [0.5, 2.0, 4.0])
def test_the_vehicle_flies_at_least_a_stride_between_images(tmp_path, slow_s):
    _, _, camera = fly_steady(tmp_path, Says(GO), LatencyPolicy.parse(f"fixed:{slow_s}"), seconds=40.0)
    strides = [math.dist(a, b) for (_, a, _), (_, b, _) in itertools.pairwise(camera.taken)]
    assert min(strides) >= 2.65
    assert strides[5:] == pytest.approx([1.2 * max(2.5, slow_s)] * len(strides[5:]), abs=0.25)


def test_without_latency_questions_have_the_papers_timing(tmp_path):
    decisions, _, _ = fly_steady(tmp_path, Says(GO, TURN, CAREFUL, THINK), LatencyPolicy.parse("fixed:0"))
    gaps = [b["t_decided"] - a["t_decided"] for a, b in itertools.pairwise(decisions)]
    assert gaps[0] == pytest.approx(2.5, abs=0.06)
    assert gaps[1] == pytest.approx(1.0, abs=0.3)  # 60° at 60°/s, until the vehicle has that heading
    assert gaps[2] <= 2.56
    assert gaps[3:] == pytest.approx([2.5] * len(gaps[3:]), abs=0.06)


def test_a_declaration_refers_to_the_image_of_its_question(tmp_path):
    """The vehicle moves on for 2 s. The log has the frame of the question and its time, not the newest frame."""
    decisions, (vehicle,), camera = fly_steady(
        tmp_path, Says(GO, GO, FINISHED), LatencyPolicy.parse("fixed:2"), seconds=14.0
    )
    declaration = decisions[2]
    assert declaration["action"] == FINISHED
    taken_s, place, _ = camera.taken[2]
    assert (declaration["frame_id"], declaration["t_frame"]) == (2, pytest.approx(taken_s))
    assert declaration["t_decided"] - declaration["t_frame"] == pytest.approx(2.0, abs=0.06)
    assert vehicle.speeds[round(declaration["t_decided"] * 20) - 1] > 1.0  # it moves until the decision
    assert vehicle.position[0] - place[0] > 2.0
    assert max(vehicle.speeds[round(declaration["t_decided"] * 20) + 2 :]) < 0.7  # and holds from then on


def test_a_place_does_not_move_with_later_motion_of_the_vehicle(tmp_path):
    """A short stride is relative to the pose at capture. Motion since then counts as a part of it."""
    decisions, (vehicle,), camera = fly_steady(
        tmp_path, Says(GO, GO, CAREFUL, THINK), LatencyPolicy.parse("fixed:2"), seconds=12.0
    )
    _, place, _ = camera.taken[2]
    goal = place[0] + 0.6 * 2.5
    assert decisions[2]["action"] == CAREFUL
    assert vehicle.position[0] == pytest.approx(max(goal, decisions_place(vehicle, camera, decisions[2])), abs=0.75)


def decisions_place(vehicle, camera, decision):
    """Return the vehicle's north position at the time of a decision."""
    return vehicle.sight(round(decision["t_decided"] * 1e6)).position_ned[0]


def test_the_next_image_is_taken_at_the_end_of_a_short_stride(tmp_path):
    """Strides then add up without overlap, and the vehicle never flies past a moving place."""
    _, _, camera = fly_steady(tmp_path, Says(CAREFUL), LatencyPolicy.parse("fixed:2"), seconds=20.0)
    places = [place[0] for _, place, _ in camera.taken]
    assert len(places) >= 5
    strides = [b - a for a, b in itertools.pairwise(places)]
    assert strides[:2] == pytest.approx([1.5 - 0.3] * 2, abs=0.1)
    assert all(1.1 <= stride <= 2.5 for stride in strides)


def test_the_vehicle_turns_before_it_moves_only_for_large_bearings(tmp_path):
    for name, x, stands_s in (("aside", 900.0, 38.7 / 60.0), ("little", 650.0, 0.0)):  # 38.7° and 16.7° off
        (tmp_path / name).mkdir()
        _, (vehicle,), _ = fly_steady(
            tmp_path / name, Says({**GO, "point": [x, 500.0]}, THINK), LatencyPolicy.parse("fixed:0"), 2.4
        )
        moved_s = 0.05 * next(k for k, speed in enumerate(vehicle.speeds) if speed > 0.0)
        assert moved_s == pytest.approx(stands_s, abs=0.15)
        expected = math.atan2(x - 500.0, 500.0)
        assert math.atan2(vehicle.position[1], vehicle.position[0]) == pytest.approx(expected, abs=0.03)


def test_a_go_without_a_new_reply_fades_and_ends(tmp_path):
    """The second reply never arrives: the first go fades after 2.5 s and ends after 5 s."""
    policy = Charged((), lambda question: 0.0 if question.step == 0 else 200.0)
    _, (vehicle,), _ = fly_steady(tmp_path, Says(GO), policy, seconds=30.0)
    begun = next(k for k, speed in enumerate(vehicle.speeds) if speed > 0.0)
    assert vehicle.speeds[begun : begun + 50] == pytest.approx([1.2] * 50, abs=0.03)
    assert all(b < a for a, b in itertools.pairwise(vehicle.speeds[begun + 52 : begun + 98]))
    assert max(vehicle.speeds[begun + 101 :]) == 0.0
    assert vehicle.position[0] == pytest.approx(1.2 * 2.5 * 1.5, abs=0.1)


@pytest.mark.parametrize("steered_s", [0.5, 2.0, 4.8, 9.0])
def test_motion_stops_soon_after_steering_stops_and_at_the_end_of_the_leg(steered_s):
    """The stream's last setpoint is valid for half a second without a new one, and never beyond the leg's 5 s."""
    vehicle = Follows()
    drone = SteadyDrone(0, vehicle, CAMERA)
    drone.see(0)
    drone.plan(Go(500.0, 500.0, 40.0))
    drone.begin(0.0)
    while vehicle.time_us < 12_000_000:
        vehicle.tick()
        if vehicle.time_us <= steered_s * 1e6:
            drone.advance(vehicle.time_us / 1e6)
    moving_s = 0.05 * max(k + 1 for k, speed in enumerate(vehicle.speeds) if speed > 0.0)
    ends_s = min(steered_s + 0.5, 5.0)
    assert ends_s - 0.06 <= moving_s <= ends_s + GRACE_US / 1e6 + 0.051


def test_a_search_turn_ends_before_the_next_question(tmp_path):
    decisions, _, camera = fly_steady(tmp_path, Says(TURN), LatencyPolicy.parse("fixed:2"), seconds=20.0)
    yaws = [yaw for _, _, yaw in camera.taken]
    assert [b - a for a, b in itertools.pairwise(yaws[:3])] == pytest.approx([math.radians(60)] * 2, abs=0.03)
    assert all(b["t_decided"] - a["t_decided"] >= 3.0 for a, b in itertools.pairwise(decisions))


def test_a_fleet_has_one_question_for_all_drones_or_one_per_drone(tmp_path):
    for name, groups in (("flat", None), ("solo", [[0], [1], [2]])):
        (tmp_path / name).mkdir()
        model = Says(GO)
        decisions, aircraft, _ = fly_steady(tmp_path / name, model, LatencyPolicy.parse("fixed:2"), 12.0, 3, groups)
        assert {d["drone"] for d in decisions} == {0, 1, 2}
        assert len(decisions) // 3 >= 4
        assert model.asked == pytest.approx(len(decisions) / 3 if groups is None else len(decisions), abs=3.0)
        assert [vehicle.position for vehicle in aircraft] == [aircraft[0].position] * 3
        assert aircraft[0].position[0] > 10.0


def test_a_repeated_image_keeps_its_pose_and_is_one_sighting():
    """Later turns and motion have no effect. A second reply to the same image is not another sighting."""
    vehicle, aside = Follows(), Go(970.0, 500.0, 8.0)  # 43° off the heading: the vehicle turns first
    drone = SteadyDrone(0, vehicle, CAMERA)
    drone.see(0)
    place = seen_place(aside, vehicle.sight(0), CAMERA).place_ned
    drone.plan(Go(500.0, 500.0, 40.0))
    drone.begin(0.0)
    while vehicle.time_us < 2_000_000:
        vehicle.tick()
        drone.advance(vehicle.time_us / 1e6)
    assert vehicle.position[0] > 2.0
    for _ in range(3):
        drone.see(0)
        drone.plan(aside)
        assert drone._place is not None
        assert drone._place.place_ned == place
        drone.begin(vehicle.time_us / 1e6)
        for _ in range(10):
            vehicle.tick()
            drone.advance(vehicle.time_us / 1e6)
    assert drone._pursuit.sightings == 1


def test_a_turn_to_a_place_of_an_earlier_image_starts_from_the_current_heading():
    vehicle, aside = Follows(), Go(30.0, 500.0, 40.0)  # 43° left of the heading at capture
    drone = SteadyDrone(0, vehicle, CAMERA)
    drone.see(0)
    for action in (Rotate(60.0), aside):
        drone.plan(action)
        drone.begin(vehicle.time_us / 1e6)
        while drone.busy:
            vehicle.tick()
            drone.advance(vehicle.time_us / 1e6)
    assert vehicle.yaw == pytest.approx(math.atan2(-470.0, 500.0), abs=0.05)
