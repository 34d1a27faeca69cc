"""Redrawn views: the drone is visible from outside, but not in its own view."""

import numpy as np
import pytest

from dronecats.view.replay.views import NO_WORLD, FlightViews, RedrawnView, ViewRenderer, ViewRequest

SMALL = (320, 180)


@pytest.fixture(scope="module")
def views(flight):
    made = FlightViews(flight.recorded, SMALL)
    yield made
    made.close()


@pytest.mark.parametrize("view", list(RedrawnView))
def test_a_view_shows_the_world_and_from_outside_the_drone(views, flight, view):
    stage = views.stage(view)
    seen = stage.view(views.eye(0, view, 3.0), 3.0)
    drone = (seen.ids == stage.ids[0]).sum()
    assert len(np.unique(seen.ids)) > 2
    if view is RedrawnView.ONBOARD:
        assert drone == 0
    else:
        assert drone > 10
        _, columns = np.nonzero(seen.ids == stage.ids[0])
        assert abs(columns.mean() / SMALL[0] - 0.5) < 0.35
    picture = views.picture(0, view, 3.0)
    assert picture.shape == (180, 320, 3)
    assert picture.std() > 10
    assert (picture != views.picture(0, view, 5.0)).mean() > 0.05  # it moves


def test_the_lens_of_a_decision_is_at_the_pose_of_its_frame(views, flight):
    one = flight.recorded.logs.decisions[0]
    shown = flight.moment(one.t_decided).drones[0]
    assert shown.lens_ned == pytest.approx(views.eye(0, RedrawnView.ONBOARD, one.t_frame).position_ned)


def test_only_the_newest_request_is_drawn_and_a_missing_world_is_reported(flight):
    drawn = []
    made = ViewRenderer([flight.recorded, None], lambda wish, picture: drawn.append((wish, picture)))
    try:
        wishes = [ViewRequest(0, 0, RedrawnView.TOP, 0.1 * k) for k in range(30)]
        for wish in wishes:
            made.put(wish)
        assert made.idle(60.0)
        assert drawn[-1][0] == wishes[-1]
        assert len(drawn) < len(wishes)
        assert not isinstance(drawn[-1][1], str)
        made.put(ViewRequest(1, 0, RedrawnView.TOP, 0.0))
        assert made.idle(60.0)
        assert drawn[-1][1] == NO_WORLD
    finally:
        made.close()
