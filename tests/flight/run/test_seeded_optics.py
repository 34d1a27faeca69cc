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


@pytest.mark.slow
def test_in_lockstep_the_same_seed_gives_the_same_noise_to_the_byte(tmp_path):
    one, again, other = (first_picture(tmp_path / name, seed) for name, seed in (("a", 1), ("b", 1), ("c", 2)))
    assert one == again
    assert abs(np.corrcoef(grain(one), grain(other))[0, 1]) < 0.1


@pytest.mark.slow("flies in real time, twice")
def test_in_real_time_the_seed_determines_the_noise(tmp_path):
    one, again, other = (first_picture(tmp_path / name, seed, 1.0) for name, seed in (("a", 1), ("b", 1), ("c", 2)))
    assert np.corrcoef(grain(one), grain(again))[0, 1] > 0.5
    assert abs(np.corrcoef(grain(one), grain(other))[0, 1]) < 0.1
