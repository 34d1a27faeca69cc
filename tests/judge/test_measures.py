"""Tests that the measures besides the success criterion match their definitions."""

from hypothesis import given
from hypothesis import strategies as st

from dronecats.judge.verdict import Measured, Measures, judge, measures

declared = st.builds(
    Measured,
    st.integers(0, 9),
    st.integers(0, 3),
    st.sampled_from([1.0, 2.0, 3.0, 300.0, 300.1]),
    st.none() | st.sampled_from([1.0, 5.0, 5.1]),
    st.sampled_from([True, True, False, None]),
)


def at(t, distance_m, visible=True, drone=0, step=0):
    return Measured(step, drone, t, distance_m, visible)


def test_declaring_everywhere_has_a_low_precision():
    assert measures([at(t, 20.0 - t) for t in range(18)]) == Measures(False, False, round(3 / 18, 4), 15)
    assert measures([at(1, 9), at(2, 9), at(3, 4)]) == Measures(False, True, 0.3333, 2)
    assert measures([at(1, 4), at(2, 9)]) == Measures(True, True, 0.5, 1)
    assert measures([]) == Measures(False, False, None, 0)


def test_the_first_declaration_of_a_fleet_is_by_time_then_step_then_drone():
    assert measures([at(2, 4, drone=0), at(1, 9, drone=3)]).success_at_first is False
    assert measures([at(1, 9, drone=1), at(1, 4, drone=0)]).success_at_first is True
    assert measures([at(1, 9, step=1), at(1, 4, step=0, drone=2)]).success_at_first is True


def test_declarations_after_the_cap_are_ignored():
    assert measures([at(300.1, 1.0)]) == Measures(False, False, None, 0)


def test_measures_of_an_incomplete_flight_may_be_unknown():
    assert measures([], is_whole=False) == Measures(None, None, None, 0)
    assert measures([at(1, 9)], is_whole=False) == Measures(False, None, 0.0, 1)
    assert measures([at(1, 9), at(2, 9), at(3, 9)], is_whole=False).success_within_three is False


def test_a_share_with_unmeasured_declarations_is_unknown():
    result = measures([at(1, 4), at(2, None, None), at(3, 9)])
    assert result == Measures(True, True, None, None)


@given(st.lists(declared, max_size=8), st.booleans())
def test_a_measure_has_a_value_exactly_if_all_possible_truths_agree(declarations, is_whole):
    result = measures(declarations, is_whole=is_whole)
    possibilities = [
        measures(filled, is_whole=is_whole)
        for filled in (fill(declarations, 0.0, True), fill(declarations, 9.0, False))
    ]
    for name in ("success_at_first", "success_within_three"):
        values = {getattr(possible, name) for possible in possibilities}
        assert getattr(result, name) == (values.pop() if len(values) == 1 else None)
    if result.false_declarations is not None:
        assert {possible.false_declarations for possible in possibilities} == {result.false_declarations}
    if result.success_at_first:
        assert result.success_within_three
    if result.success_within_three:
        assert judge(declarations, None).success


def fill(declarations, distance_m, visible):
    """Return the declarations with these values in place of unmeasured values."""
    return [
        Measured(
            d.step,
            d.drone,
            d.t,
            distance_m if d.distance_m is None else d.distance_m,
            visible if d.visible is None else d.visible,
        )
        for d in declarations
    ]
