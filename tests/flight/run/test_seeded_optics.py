"""The seed of a flight determines its camera noise."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from episodes.camera.optics.options import Optics, Sensor

NOISY = Optics(sensor=Sensor(full_well_e=50.0)).as_dict()
SPEC = FlightSpec(
    pilot="blind:straight",
    episode="residential-approaching-03",
    simulated=Simulated(speed=None, optics=NOISY),
    full=True,
)


def first_picture(folder, seed, speed=None):
    """Fly, and return the bytes of the first picture with a decision."""
    assert SPEC.simulated is not None
    latency = LatencyPolicy.parse("fixed:0.5" if speed is None else "real")
    seconds = 2.0 if speed is None else 10.0  # the first reply must arrive within this time
    simulated = replace(SPEC.simulated, speed=speed)
    spec = replace(SPEC, seed=seed, latency=latency, seconds=seconds, simulated=simulated)
    result = fly(spec, folder, lambda line: None)
    assert result["reason"] == "cap", result["error"]
    return min(folder.rglob("frames/*.jpg")).read_bytes()


def grain(jpeg):
    """Return the detail of a picture that is finer than a pixel's neighbourhood. It is nearly all noise."""
    grey = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE), float)
    return (grey - cv2.GaussianBlur(grey, (0, 0), 1.0)).ravel()


@pytest.fixture(scope="module")
def in_lockstep(tmp_path_factory):
    """The first pictures of seeds 1 and 2."""
    return {seed: first_picture(tmp_path_factory.mktemp("lockstep"), seed) for seed in (1, 2)}


@pytest.mark.slow
def test_in_lockstep_the_same_seed_gives_the_same_noise_to_the_byte(in_lockstep, tmp_path):
    assert first_picture(tmp_path, 1) == in_lockstep[1]
    assert abs(np.corrcoef(grain(in_lockstep[1]), grain(in_lockstep[2]))[0, 1]) < 0.1


@pytest.mark.slow("flies in real time")
def test_in_real_time_the_seed_gives_the_noise_of_lockstep(in_lockstep, tmp_path):
    """The pictures differ a little, because the drone is not at exactly the same place."""
    real = grain(first_picture(tmp_path, 1, 1.0))
    assert np.corrcoef(real, grain(in_lockstep[1]))[0, 1] > 0.5
    assert abs(np.corrcoef(real, grain(in_lockstep[2]))[0, 1]) < 0.1
