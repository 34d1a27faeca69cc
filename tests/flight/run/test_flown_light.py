"""A flight in other light conditions is rendered, recorded and redrawn in the same light."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.disturbances import UNDISTURBED, Disturbances, FlightConditions
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_json
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.identity import differences, identity
from dronecats.view.live.folder import load_world
from episodes.camera.renderer import Renderer
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose
from foundation.conditions import SceneConditions

DUSK = Disturbances(conditions=FlightConditions(sky="dusk"))
SPEC = FlightSpec(
    pilot="blind:straight",
    episode="residential-approaching-03",
    simulated=Simulated(speed=None),
    disturbances=DUSK,
    seconds=2.0,
    full=True,
)
SMALL = CameraModel(640, 360)


def run_of(tmp_path, spec):
    return RecordedRun(folder=tmp_path, configuration={"flight": as_json(spec)}, episodes=())


def test_flights_in_different_light_have_different_identities(tmp_path):
    dusk, plain = (identity(run_of(tmp_path, spec)) for spec in (SPEC, replace(SPEC, disturbances=UNDISTURBED)))
    assert [difference.name for difference in differences(dusk, plain)] == ["disturbances.conditions.sky"]
    assert not any("conditions" in name for name in plain)  # identities of earlier flights do not change
    assert run_of(tmp_path, SPEC).conditions == SceneConditions(sky="dusk")
    assert RecordedRun(folder=tmp_path, configuration={}, episodes=()).conditions == SceneConditions()


def redrawn(flight: RecordedFlight, world: World):
    """Return the picture from the true pose at the flight's first frame, drawn as in film and replay."""
    first = flight.frames[0]
    row = flight.logs.frames[first.frame_id, first.drone]
    assert row.yaw_deg is not None
    assert row.position_ned is not None
    yaw = np.radians(row.yaw_deg)
    pose = camera_pose(row.position_ned, (float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))), SMALL)
    renderer = Renderer(world.filmed, SMALL, 1)
    try:
        return renderer.picture(pose, world.moved(0.0, {})).astype(float)
    finally:
        renderer.close()


@pytest.mark.slow("flies once in lockstep and once in real time")
@pytest.mark.parametrize("speed", [None, 1.0])
def test_a_flight_is_redrawn_in_its_own_light(tmp_path, speed):
    latency = LatencyPolicy.parse("fixed:0.5" if speed is None else "real")
    simulated = Simulated(speed=speed)
    seconds = 2.0 if speed is None else 10.0  # the first reply must arrive within this time
    result = fly(replace(SPEC, simulated=simulated, latency=latency, seconds=seconds), tmp_path / "run", lambda _: None)
    assert result["reason"] == "cap", result["error"]
    (folder,) = (tmp_path / "run").glob("*/episode.json")
    flight = RecordedFlight.read(folder.parent)
    seen = cv2.imdecode(np.frombuffer(flight.frames[0].jpeg.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    assert seen is not None
    seen = seen[..., ::-1].astype(float)
    live = load_world(folder.parent)
    assert live is not None
    for world in (flight.world, live):
        assert np.abs(redrawn(flight, world) - seen).mean() < 6.0
    assert np.abs(redrawn(flight, World(flight.world.record)) - seen).mean() > 25.0
