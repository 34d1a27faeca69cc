"""Compares Holm's correction with statsmodels."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.judge.statistics.shares import holm


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40))
def test_holm_equals_statsmodels(ps):
    from statsmodels.stats.multitest import multipletests

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gc.collect", lambda: 0)  # statsmodels collects garbage at every call, which takes 0.25 s
        assert holm(ps) == pytest.approx(list(multipletests(ps, method="holm")[1]))


def test_holm_matches_a_hand_calculation():
    assert holm([]) == []
    assert holm([0.04, 0.01, 0.03]) == pytest.approx([0.06, 0.03, 0.06])
