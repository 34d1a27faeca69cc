"""Tests Algorithm 1 of the paper and the audit cases of its appendix."""

from hypothesis import given
from hypothesis import strategies as st

from dronecats.judge.verdict import Measured, judge

measured = st.builds(
    Measured, st.integers(0, 99), st.integers(0, 3), st.floats(0, 600), st.floats(0, 60), st.booleans()
)


def at(t, distance, visible=True, step=0):
    return Measured(step, 0, t, distance, visible)


def test_the_first_qualifying_declaration_decides():
    verdict = judge([at(50, 1.0), at(10, 9.0), at(30, 4.2), at(20, 3.0, visible=False)], at(60, 0.5))
    assert verdict.success
    assert verdict.ne_m == 4.2
    assert verdict.deciding is not None
    assert verdict.deciding.t == 30


def test_the_radius_is_inclusive():
    assert judge([at(1, 5.0)], None).success
    assert not judge([at(1, 5.0001)], at(1, 5.0001)).success


def test_a_declaration_after_the_cap_does_not_count():
    assert not judge([at(300.001, 1.0)], at(299, 8.0)).success
    assert judge([at(300.0, 1.0)], None).success


def test_proximity_without_a_declaration_fails_with_the_last_distance():
    verdict = judge([], at(299, 0.4))
    assert not verdict.success
    assert verdict.ne_m == 0.4


@given(st.lists(measured, max_size=12), st.none() | measured)
def test_the_verdict_agrees_with_the_definition(declarations, last):
    verdict = judge(declarations, last)
    qualifying = [d for d in declarations if d.t <= 300 and d.distance_m <= 5 and d.visible]
    assert verdict.success == bool(qualifying)
    if qualifying:
        assert verdict.deciding in qualifying
        assert verdict.deciding is not None
        assert verdict.deciding.t == min(d.t for d in qualifying)
        assert verdict.ne_m == verdict.deciding.distance_m
    else:
        assert verdict.ne_m == (last.distance_m if last else None)


# each drone has each step once; judged_flight.gaps detects other logs
@given(st.lists(measured, max_size=12, unique_by=lambda d: (d.step, d.drone)), st.permutations(range(12)))
def test_the_order_of_the_log_does_not_matter(declarations, order):
    shuffled = [declarations[i] for i in order if i < len(declarations)]
    assert judge(shuffled, None) == judge(declarations, None)


def unmeasured(t):
    return Measured(0, 0, t, None, None, "nobody looked")


def test_unmeasured_declarations_cannot_undo_a_success():
    for early, late in ((10, 50), (50, 10)):
        verdict = judge([unmeasured(early), at(late, 4.0)], unmeasured(60))
        assert verdict.deciding is not None
        assert (verdict.success, verdict.ne_m, verdict.deciding.t) == (True, 4.0, late)
        assert [d.t for d in verdict.unknown] == ([early] if early < late else [])


def test_without_a_success_an_unmeasured_declaration_makes_the_verdict_unknown():
    verdict = judge([at(10, 9.0), unmeasured(20)], at(60, 1.0))
    assert (verdict.success, verdict.ne_m) == (None, None)
    assert [d.t for d in verdict.unknown] == [20]
    assert judge([at(10, 9.0), unmeasured(301)], at(60, 1.0)).success is False


def test_an_unmeasured_last_action_leaves_only_the_navigation_error_unknown():
    verdict = judge([at(10, 9.0)], unmeasured(60))
    assert (verdict.success, verdict.ne_m) == (False, None)


def test_a_partial_measurement_can_rule_out_a_declaration():
    assert Measured(0, 0, 1.0, 9.0, None).qualifies() is False
    assert Measured(0, 0, 1.0, None, False).qualifies() is False
    assert Measured(0, 0, 1.0, 1.0, None).qualifies() is None
    assert Measured(0, 0, 1.0, None, True).qualifies() is None
