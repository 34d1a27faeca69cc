"""Referring expressions: left and right depend on the viewer's position, and ambiguous expressions do not refer."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from episodes.authoring.check.referring import (
    RELATIONS,
    Expression,
    Footprint,
    denotes,
    expressions,
    kind_of,
    nouns,
    read,
    refers,
)

FOUNTAIN = Footprint(20.0, 0.0, (1.0, 1.0), 0.0)
STATUE = Footprint(20.0, 20.0, (1.0, 1.0), 0.0)
HALL = Footprint(0.0, 50.0, (20.0, 5.0), 0.0)
MARKS = {"the fountain": FOUNTAIN, "the statue": STATUE, "Euler Hall": HALL}
VIEWER = (0.0, 0.0, -1.5)  # looks north at the fountain


def named(relation: str, place: tuple[float, float], *marks: str, others: dict[str, Any] | None = None) -> bool:
    things = {"it": (*place, 0.0), **(others or {})}
    return refers(Expression("bench", relation, marks or ("the fountain",)), "it", things, MARKS, VIEWER)


def test_sides_depend_on_the_viewers_position() -> None:
    for relation, place in (
        ("left of", (20.0, -5.0)),
        ("right of", (20.0, 5.0)),
        ("in front of", (15.0, 0.0)),
        ("behind", (26.0, 1.0)),
        ("nearest", (26.0, -6.0)),
    ):
        held = [how for how in RELATIONS if how != "between" and named(how, place)]
        assert relation in held, relation
        assert set(held) <= {relation, "nearest"}, relation
        if relation != "nearest":
            behind_it = (40.0, 0.0, -1.5)
            seen = denotes(Expression("bench", relation, ("the fountain",)), {"it": (*place, 0.0)}, MARKS, behind_it)
            assert seen == ([], []), relation


def test_between_refers_to_the_space_between_two_landmarks() -> None:
    assert named("between", (20.0, 11.0), "the fountain", "the statue")
    assert not named("between", (20.0, 30.0), "the fountain", "the statue")
    assert not named("between", (30.0, 10.0), "the fountain", "the statue")
    assert not named("between", (10.0, 25.0), "the fountain", "Euler Hall")  # a hall is not a point


def test_a_plausible_rival_makes_a_reference_ambiguous() -> None:
    assert named("left of", (20.0, -5.0), others={"far": (-60.0, 3.0, 0.0)})
    assert not named("left of", (20.0, -5.0), others={"rival": (24.0, -3.0, 0.0)})
    assert named("nearest", (20.0, -3.0), others={"rival": (20.0, 9.0, 0.0)})
    assert not named("nearest", (20.0, -3.0), others={"rival": (20.0, 4.0, 0.0)})
    assert not named("nearest", (20.0, -40.0))


def test_distance_to_a_building_is_measured_to_its_wall() -> None:
    assert HALL.distance_m((19.0, 44.0)) == pytest.approx(1.0)
    turned = Footprint(0.0, 0.0, (10.0, 1.0), math.pi / 2)
    assert turned.distance_m((0.0, 12.0)) == pytest.approx(2.0)
    assert turned.distance_m((3.0, 0.0)) == pytest.approx(2.0)
    assert named("nearest", (19.0, 40.0), "Euler Hall", others={"mid": (0.0, 20.0, 0.0)})


@given(st.floats(-math.pi, math.pi), st.floats(3.0, 11.0), st.floats(0.0, 2.0 * math.pi))
def test_references_do_not_change_when_the_scene_is_rotated(off: float, away: float, turned: float) -> None:
    """The rotation includes the viewer."""

    def around(n: float, e: float) -> tuple[float, float, float]:
        c, s = math.cos(turned), math.sin(turned)
        return (c * n - s * e, s * n + c * e, 0.0)

    place = (20.0 + away * math.cos(off), away * math.sin(off))
    mark = around(20.0, 0.0)
    moved = {"the fountain": Footprint(mark[0], mark[1], (1.0, 1.0), turned)}
    for how in RELATIONS:
        if how != "between":
            here = denotes(Expression("x", how, ("the fountain",)), {"it": (*place, 0.0)}, MARKS, VIEWER)
            there = denotes(Expression("x", how, ("the fountain",)), {"it": around(*place)}, moved, (0.0, 0.0, -1.5))
            edge = min(abs(math.remainder(off - k * math.pi / 4, math.pi / 4)) for k in range(8))
            if edge > 1e-3:
                assert len(here[0]) == len(there[0]) or abs(away - 12.0) < 0.01


def test_a_worded_expression_is_parsed_back() -> None:
    for pattern in ("go to {}", "find {} and go to it", "locate {}, go after it and reach it"):
        for relation in RELATIONS:
            marks = ("the fountain", "Euler Hall") if relation == "between" else ("Euler Hall",)
            expression = Expression("bike rack", relation, marks)
            assert read(pattern.format(expression.words), MARKS) == expression, (relation, pattern)


def test_an_expression_with_an_unknown_landmark_is_not_parsed() -> None:
    assert read("go to the bench left of the obelisk", MARKS) is None
    assert read("go to the bench", MARKS) is None
    assert read("go to the bench to the left of the statue", MARKS) == Expression("bench", "left of", ("the statue",))
    assert read("go to the bench nearest the statues", MARKS) is None


def test_every_suggested_expression_is_unambiguous() -> None:
    things = {"it": (20.0, -5.0, 0.0), "other": (21.0, 15.0, 0.0)}
    offered = expressions("bench", "it", things, MARKS, VIEWER)
    assert {expression.relation for expression in offered} >= {"left of", "nearest"}
    assert all(refers(expression, "it", things, MARKS, VIEWER) for expression in offered)


def test_a_pedestrian_has_the_kind_and_nouns_of_a_person() -> None:
    assert kind_of("pedestrian") == kind_of("person")
    assert kind_of("delivery_robot") == "delivery-robot"
    assert set(nouns("pedestrian")) == set(nouns("person"))
