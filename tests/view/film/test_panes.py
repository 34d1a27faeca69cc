"""The panes beside the chase view: camera frame, ring, map and captions."""

import json
import math
import shutil

import numpy as np
import pytest

from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun
from dronecats.view.film import composition
from dronecats.view.film.composition import MapPane, action_words, caption_bar, chosen, panes, pilot_view, verdict_words
from dronecats.view.film.lettering import MAGENTA, YELLOW, fitted, width_px
from foundation.run_folder import layout
from tests.view.film.conftest import GREY


def near(picture, x, y, color, reach=1):
    """Return whether a pixel within `reach` of (x, y) has about that colour."""
    part = picture[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1].astype(int)
    return bool((np.abs(part - np.array(color)).max(axis=-1) < 60).any())


@pytest.fixture(scope="module")
def going(flight):
    return next(each for each in flight.logs.decisions if chosen(each) is not None)


def test_the_ring_surrounds_the_chosen_point_from_the_decision_on(flight, going, composed):
    x, y = (share / 1000 for share in going.action["point"])
    for picture, pane in (
        (pilot_view(flight, 0, going.t_decided, 400, 225, 1.0), None),
        (composed.at(going.t_decided), composed.panes.onboard[0]),
    ):
        left, top, wide, high = (pane.left, pane.top, pane.width, pane.height) if pane else (0, 0, 400, 225)
        middle, radius = (left + x * wide, top + y * high), max(5.0, 0.05 * wide)
        for turn in (0.8, 2.4, 4.0, 5.5):
            at = (round(middle[0] - 0.5 + radius * math.cos(turn)), round(middle[1] - 0.5 + radius * math.sin(turn)))
            assert near(picture, *at, YELLOW), at
        assert not near(picture, round(middle[0]), round(middle[1]), YELLOW)
    earlier = pilot_view(flight, 0, going.t_decided - 0.01, 400, 225, 1.0)
    assert not (np.abs(earlier.astype(int) - YELLOW).max(axis=-1) < 60).any()


def test_the_frame_is_shown_unchanged_and_a_missing_one_is_marked(flight, going, tmp_path):
    shown = pilot_view(flight, 0, going.t_frame, 400, 225, 1.0)
    assert np.abs(shown[20:180, 20:380].astype(int) - GREY).max() <= 2
    unrendered = tmp_path / "unrendered" / flight.id
    shutil.copytree(flight.folder.parent, unrendered.parent)
    without = RecordedFlight.read(unrendered)
    shutil.rmtree(unrendered / layout.FRAMES)
    dark = pilot_view(without, 0, going.t_frame, 400, 225, 1.0)
    assert np.median(dark[20:180]) < 40
    assert dark[100:130].max() > 100  # the caption
    configuration = json.loads((unrendered.parent / layout.RUN).read_text())
    configuration["flight"]["simulated"]["rendered"] = False
    (unrendered.parent / layout.RUN).write_text(json.dumps(configuration))
    unseen = pilot_view(RecordedFlight.read(unrendered), 0, going.t_frame, 400, 225, 1.0)
    assert not np.array_equal(unseen, dark)


def test_the_map_shows_target_ring_and_drone_at_their_positions(flight):
    drawn = MapPane(flight, 400, 375, 1.0)
    before, t = drawn.at(0.0), flight.end_s
    picture, centre = drawn.at(t), flight.world.target_centre(t)
    x, y = drawn.px(centre)
    assert near(picture, round(x), round(y), MAGENTA, 2)
    turns = np.linspace(0.0, 2 * math.pi, 90)
    on_ring = [
        (round(x + 5.0 / drawn.per_px * math.sin(a)), round(y - 5.0 / drawn.per_px * math.cos(a))) for a in turns
    ]
    assert 30 <= sum(near(picture, *at, MAGENTA) for at in on_ring) <= 80  # dashed
    first = flight.tracks[0].at(0.0).position_ned
    drone = drawn.px(flight.tracks[0].at(t).position_ned)
    assert math.dist(drone, drawn.px(first)) > 10.0
    amber = (255, 176, 0)
    assert near(picture, round(drone[0]), round(drone[1]), amber, 3)
    assert not near(before, round(drone[0]), round(drone[1]), amber, 1)
    # north is up
    assert drawn.px((first[0] + 1.0, first[1], 0.0))[1] < drawn.px(first)[1]


def test_the_captions_follow_the_flight(flight, going):
    words = action_words(flight, 0, going.t_decided)[0]
    assert words.startswith(f"step {going.step} ")
    assert "go (" in words
    assert "go (" not in action_words(flight, 0, going.t_frame + 0.01)[0]
    outcome, ne_m = flight.verdict.outcome, flight.verdict.ne_m
    assert str(outcome) in verdict_words(flight)[0].lower()
    assert ne_m is None or f"{ne_m:.2f} m" in verdict_words(flight)[0]


@pytest.mark.parametrize("size", [(480, 270), (1280, 720)])
def test_the_verdict_does_not_cover_other_captions(flight, size, monkeypatch):
    width, height = size
    title = property(lambda run: "somebody whose name is as long as that, no model")
    monkeypatch.setattr(RecordedRun, "pilot_title", title)
    placed = panes(width, height, 1)
    where = (placed.bar.width, placed.bar.height, placed.unit)
    over = caption_bar(flight, flight.end_s, 1.0, True, *where).astype(int)
    monkeypatch.setattr(composition, "is_decided", lambda flight, t: False)
    before = caption_bar(flight, flight.end_s, 1.0, False, *where).astype(int)
    words, verdict = (before > 60).any(axis=-1), np.abs(over - before).max(axis=-1) > 20
    assert verdict.any()
    assert not (words & verdict).any()


def test_fitted_text_stays_within_width_and_lines():
    long = "go to the van that stands between the red car and the second house on the left, then wait"
    for lines in (1, 2):
        fitted_lines = fitted(long, 20, 300, lines, True)
        assert len(fitted_lines) == lines
        assert all(width_px(line, 20, True) <= 300 for line in fitted_lines)
        assert fitted_lines[-1].endswith("…")
    assert fitted("short", 20, 300) == ["short"]


def test_panes_do_not_overlap_and_stay_in_the_picture():
    for size in ((1280, 720), (320, 180), (854, 480)):
        for drones in (1, 2, 3, 4, 8):
            width, height = size
            covered = np.zeros((height, width), int)
            division = panes(width, height, drones)
            for pane in (*division.chase, *division.onboard, division.map, division.bar):
                assert pane.width > 0, (drones, size)
                assert pane.height > 0, (drones, size)
                assert pane.left + pane.width <= width, (drones, size)
                assert pane.top + pane.height <= height, (drones, size)
                covered[pane.top : pane.top + pane.height, pane.left : pane.left + pane.width] += 1
            assert covered.max() == 1, (drones, size)
            assert covered.mean() > 0.8, (drones, size)  # with three drones, a quarter of their area is empty
