"""A custom agent flies with depth pictures. The run stores them next to its frames."""

import json
from functools import partial

import numpy as np
import pytest

from dronecats.agent.loop import PaperAgent
from dronecats.flight.run.fly import fly
from dronecats.flight.run.pilot import questions_of
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from foundation.camera import decode_depth
from foundation.run_folder.layout import depth_name


class DeepAgent(PaperAgent):
    """The paper's agent under another name."""


def deep_agent(flight, model):
    return partial(DeepAgent, questions_of(flight, model))


@pytest.mark.slow
def test_a_depth_picture_is_stored_for_each_frame(tmp_path):
    spec = FlightSpec(
        pilot="blind:straight",
        episode="residential-approaching-03",
        simulated=Simulated(speed=None, camera="depth"),
        agent=f"{__name__}:deep_agent",
        seconds=4.0,
        full=True,
    )
    result = fly(spec, tmp_path / "run", lambda line: None)
    assert result["reason"] == "cap", result["error"]
    (frames,) = (tmp_path / "run").glob("*/frames")
    kept = sorted(frames.glob("*.jpg"))
    assert kept
    for picture in kept:
        depth = decode_depth((frames / depth_name(int(picture.stem))).read_bytes())
        assert depth is not None
        assert depth.shape == (360, 640)
        assert 0.2 < np.mean(depth > 0) < 1.0
    assert "mm" in json.loads((tmp_path / "run" / "run.json").read_text())["camera"]["depth"]
