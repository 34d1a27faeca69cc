"""The measures beside the criterion, held to what they say they are."""

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


def test_who_declares_everywhere_succeeds_and_is_seen_to_guess():
    assert measures([at(t, 20.0 - t) for t in range(18)]) == Measures(False, False, round(3 / 18, 4), 15)
    assert measures([at(1, 9), at(2, 9), at(3, 4)]) == Measures(False, True, 0.3333, 2)
    assert measures([at(1, 4), at(2, 9)]) == Measures(True, True, 0.5, 1)
    assert measures([]) == Measures(False, False, None, 0)


def test_a_fleets_first_is_the_first_by_time_then_step_then_drone():
    assert measures([at(2, 4, drone=0), at(1, 9, drone=3)]).success_at_first is False
    assert measures([at(1, 9, drone=1), at(1, 4, drone=0)]).success_at_first is True
    assert measures([at(1, 9, step=1), at(1, 4, step=0, drone=2)]).success_at_first is True


def test_what_came_after_the_cap_never_was():
    assert measures([at(300.1, 1.0)]) == Measures(False, False, None, 0)


def test_a_flight_not_seen_to_its_cap_might_still_have_declared():
    assert measures([], is_whole=False) == Measures(None, None, None, 0)
    assert measures([at(1, 9)], is_whole=False) == Measures(False, None, 0.0, 1)
    assert measures([at(1, 9), at(2, 9), at(3, 9)], is_whole=False).success_within_three is False


def test_a_share_of_what_was_not_measured_is_not_known():
    told = measures([at(1, 4), at(2, None, None), at(3, 9)])
    assert told == Measures(True, True, None, None)


@given(st.lists(declared, max_size=8), st.booleans())
def test_known_or_not_is_what_any_truth_of_the_unmeasured_could_make_of_it(declarations, whole):
    told = measures(declarations, is_whole=whole)
    could = [
        measures(filled, is_whole=whole) for filled in (fill(declarations, 0.0, True), fill(declarations, 9.0, False))
    ]
    for name in ("success_at_first", "success_within_three"):
        values = {getattr(each, name) for each in could}
        assert getattr(told, name) == (values.pop() if len(values) == 1 else None)
    if told.false_declarations is not None:
        assert {each.false_declarations for each in could} == {told.false_declarations}
    if told.success_at_first:
        assert told.success_within_three
    if told.success_within_three:
        assert judge(declarations, None).success


def fill(declarations, distance_m, visible):
    """The same declarations, had the unmeasured ones been this."""
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
