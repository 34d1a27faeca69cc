"""One rule says whether a declaration is a success, also where pictures and pages once had rules of their own."""

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
        (decision(0, 1, 10.0), frame(1, 9.4, 3.0), None),  # not the picture that the decision was made on
        (decision(0, 1, 10.0), frame(1, 9.5, 4.0, **NEAR), None),  # its distance is not that of its positions
        (decision(0, 1, 300.5), frame(1, 300.0, 3.0), False),  # after the cap
        (decision(0, 2, 10.0), frame(1, 9.5, 3.0), None),
        (decision(0, 1, 10.0, action="think"), frame(1, 9.5, 3.0), None),
    ],
)
def test_a_declaration_qualifies(declared, seen, expected):
    told = logs([declared], [seen])
    assert qualifies(told.decisions[0], told) is expected


def test_nobodys_truth_qualifies_nothing():
    told = logs([decision(0, 1, 10.0)], [frame(1, 9.5, 3.0)], begin={**BEGIN, "source": "estimate"})
    assert qualifies(told.decisions[0], told) is None


def test_radius_and_cap_are_those_of_the_judging():
    told = logs([decision(0, 1, 10.0)], [frame(1, 9.5, 3.0)])
    assert qualifies(told.decisions[0], told, 2.0) is False
    assert qualifies(told.decisions[0], told, 5.0, 9.0) is False


def test_pictures_pages_and_films_have_no_rule_of_their_own():
    for module in (flight_picture, flights, composition, moments):
        assert vars(module)["qualifies"] is qualifies
