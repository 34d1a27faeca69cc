"""The small map of the editor's tests, and moments to show."""

from dataclasses import replace

import numpy as np
import pytest

from dronecats.view.editor.draft import Drafting
from dronecats.view.live.moment import DroneMoment, JudgeMoment, Moment, ShownPicture
from episodes import maps
from episodes.world.world import World
from foundation.camera import encode
from foundation.run_folder.rows import Decision
from tests.view.editor.conftest import port as port
from tests.view.editor.conftest import yard as yard

GO = {"action": "go", "point": [250.0, 500.0], "depth_m": 6.0}


@pytest.fixture
def world(yard):
    """Return a world on the small map with a target on it."""
    return World(Drafting(maps.build(yard)).new(yard).record)


def picture(frame_id: int, t_s: float | None = 1.0) -> ShownPicture:
    return ShownPicture(frame_id, encode(np.full((36, 64, 3), 90, np.uint8)), t_s)


def moment(world: World, t_s: float = 1.0, drones: int = 1, **changes) -> Moment:
    """Return a moment with all values known."""
    decision = Decision(
        step=3, drone=0, frame_id=3, t_frame=0.5, t_decided=t_s, reply="<b>go</b>", action=GO, rate_hz=0.4
    )
    one = DroneMoment(
        drone=0, position_ned=(1.0 + t_s, 2.0, -2.0), attitude=(1.0, 0.0, 0.0, 0.0), velocity_ned=(1.0, 0.0, 0.0),
        height_m=2.0, true=True, setpoint_ned=(1.2, 0.0, 0.0), mode="OFFBOARD", armed=True, battery=0.9,
        messages=("Armed",), prompt="fly & see", picture=picture(3), decision=decision, decided_on=picture(3),
        chosen_ned=(7.0, 2.0, -2.0), lens_ned=(1.5, 2.0, -1.9),
    )  # fmt: skip
    fleet = tuple(
        replace(
            one, drone=k, position_ned=(1.0 + t_s, 2.0 + 2.0 * k, -2.0), decision=replace(decision, drone=k), **changes
        )
        for k in range(drones)
    )
    judge = JudgeMoment(world.target_centre(t_s), (6.54321,) * drones, ("verdict: success",))
    return Moment(t_s, fleet, judge, world.moved(t_s), "in the air", 0.4, "go to it")
