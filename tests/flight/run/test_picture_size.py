"""The pilot vision refuses a real camera whose pictures have another size than 1280×720."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from dronecats.agent.models.spec import ModelSpec
from dronecats.flight.run import connected
from dronecats.flight.run.setup import Instruments
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import Connected, FlightSpec
from foundation.camera import CameraModel
from foundation.errors import UsageError

VEHICLE = Connected(url="udpin://127.0.0.1:14599", camera="v4l2:0")
MODEL = ModelSpec(provider="local", name="m", base_url="http://127.0.0.1:9/v1")


@pytest.fixture
def closed(monkeypatch):
    """The names of the closed devices. The camera gives 640×480."""
    names: list[str] = []
    link = SimpleNamespace(close=lambda: names.append("link"))
    camera = SimpleNamespace(model=CameraModel(640, 480), close=lambda: names.append("camera"))

    def opened(vehicle, link, undo):
        undo.callback(camera.close)
        return camera

    monkeypatch.setattr(connected, "open_link", lambda vehicle, limits: link)
    monkeypatch.setattr(connected, "_camera", opened)
    return names


def begin(**pilot: Any):
    flight = look_up(FlightSpec(connected=VEHICLE, instruction="go to the red van", **pilot))
    return connected.ConnectedFlight(flight, cast(Connected, flight.spec.connected), Instruments())


def test_vision_needs_pictures_of_1280_by_720(closed):
    with pytest.raises(UsageError, match=r"vision .*1280×720.* 640×480"):
        begin(pilot="vision")
    assert sorted(closed) == ["camera", "link"]


def test_models_accept_pictures_of_any_size(closed):
    assert begin(model=MODEL).camera_model.height == 480
    assert not closed
