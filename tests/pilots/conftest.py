"""Flights without dynamics: the agent's rules are executed exactly, on rendered frames or on the truth alone."""

import math
from dataclasses import dataclass, field
from typing import Any

import pytest

from dronecats.agent.action import Finished
from dronecats.agent.controller import plan
from dronecats.agent.prompt import History, Prompt
from dronecats.agent.reply.strict import parse
from foundation.camera import CameraModel, encode
from foundation.frames import quat_from_euler, wrap_pi
from foundation.protocol import HISTORY_LENGTH
from foundation.setpoints import Turn, Velocity

HALF = CameraModel(640, 360)  # a pilot gets a 1280 × 720 frame resized to this


@dataclass
class KinematicFlight:
    """The declarations, distances and actions of a flight."""

    declared: list[Any] = field(default_factory=list)  # (time s, distance m, visible) of each declaration
    distances: list[Any] = field(default_factory=list)  # m, body to target centre at each frame
    clearances: list[Any] = field(default_factory=list)  # m, to the nearest solid or the target's box, at each frame
    actions: list[Any] = field(default_factory=list)

    @property
    def success(self):
        return any(d <= 5.0 and visible for _, d, visible in self.declared)


def fly(world, decide, cap_s=300.0, latency_s=0.3, start=None, stop_at_success=True):
    """Fly in a world until a success or the end of the time. `decide(prompt, position, yaw, t)` returns a reply."""
    start = start or world.record.starts[0]
    position, yaw, t = list(start.position_ned), math.radians(start.yaw_deg), 0.0
    history, flight, prompt = History(CameraModel()), KinematicFlight(), Prompt.load()
    while t < cap_s:
        truth = world.measure(t, tuple(position), quat_from_euler(0, 0, yaw), CameraModel())
        flight.distances.append(truth.distance_m)
        flight.clearances.append(min(world.clearance_m(tuple(position)), truth.distance_box_m))
        text = prompt.render(world.record.instruction, history.render(), HISTORY_LENGTH)
        action = parse(decide(text, tuple(position), yaw, t))
        t += latency_s
        history.append(action)
        flight.actions.append(action)
        if isinstance(action, Finished):
            flight.declared.append((t, truth.distance_m, truth.visible))
            if flight.success and stop_at_success:
                break
        for segment in plan(action, CameraModel()):
            t += segment.duration_s
            match segment.setpoint:
                case Turn():
                    yaw = wrap_pi(yaw + segment.setpoint.yaw_rate * segment.duration_s)
                case Velocity():
                    position[0] += segment.setpoint.forward * segment.duration_s * math.cos(yaw)
                    position[1] += segment.setpoint.forward * segment.duration_s * math.sin(yaw)
                    position[2] -= (segment.setpoint.up or 0.0) * segment.duration_s
    return flight


@pytest.fixture(scope="session")
def fly_kinematic():
    return fly


@pytest.fixture(scope="session")
def eye():
    """Return a function (world) → function (position, yaw, t) → JPEG, with one renderer per world."""
    from episodes.camera.renderer.renderer import Renderer
    from foundation.camera import camera_pose

    def open_eye(world):
        renderer = Renderer(world.scene, HALF)

        def see(position, yaw, t):
            pose = camera_pose(position, quat_from_euler(0, 0, yaw), HALF)
            return encode(renderer.render(pose, world.moved(t)).rgb)

        return see

    return open_eye
