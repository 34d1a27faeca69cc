"""Tests the judge's rule for a successful declaration. Pictures, pages and films use the same rule."""

import pytest

from dronecats.flight import picture as flight_picture
from dronecats.judge.verdict import qualifies
from dronecats.report.page import flights
from dronecats.view.film import composition
from dronecats.view.replay import moments
from tests.judge.episode_logs import BEGIN, decision, frame, logs

NEAR = {"position_ned": [0.0, 0.0, -2.0], "target_ned": [3.0, 0.0, -2.0]}


@pytest.mark.parametrize(
    ("declared", "seen", "expected"),
    [
        (decision(0, 1, 10.0), frame(1, 9.5, 3.0, **NEAR), True),
        (decision(0, 1, 10.0), frame(1, 9.5, 3.0, visible=None), None),
        (decision(0, 1, 10.0), frame(1, 9.5, 9.0, visible=None), False),
        (decision(0, 1, 10.0), frame(1, 9.5, None, visible=False), False),
        (decision(0, 1, 10.0), frame(1, 9.5, None, visible=True), None),
        (decision(0, 1, 10.0), frame(1, 9.4, 3.0), None),  # not the time of the decision's picture
        (decision(0, 1, 10.0), frame(1, 9.5, 4.0, **NEAR), None),  # its distance contradicts its positions
        (decision(0, 1, 300.5), frame(1, 300.0, 3.0), False),  # after the cap
        (decision(0, 2, 10.0), frame(1, 9.5, 3.0), None),
        (decision(0, 1, 10.0, action="think"), frame(1, 9.5, 3.0), None),
    ],
)
def test_a_declaration_qualifies_by_distance_visibility_and_time(declared, seen, expected):
    flight = logs([declared], [seen])
    assert qualifies(flight.decisions[0], flight) is expected


def test_with_an_estimated_truth_qualification_is_unknown():
    flight = logs([decision(0, 1, 10.0)], [frame(1, 9.5, 3.0)], begin={**BEGIN, "source": "estimate"})
    assert qualifies(flight.decisions[0], flight) is None


def test_radius_and_cap_are_arguments():
    flight = logs([decision(0, 1, 10.0)], [frame(1, 9.5, 3.0)])
    assert qualifies(flight.decisions[0], flight, 2.0) is False
    assert qualifies(flight.decisions[0], flight, 5.0, 9.0) is False


def test_pictures_pages_and_films_use_the_function_of_the_judge():
    for module in (flight_picture, flights, composition, moments):
        assert vars(module)["qualifies"] is qualifies
