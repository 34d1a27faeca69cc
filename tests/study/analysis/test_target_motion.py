"""The width of the camera's view at the target's depth, computed from log rows."""

import pytest

from dronecats.study.analysis.steps import view_width
from tests.judge.episode_logs import decision, frame
from tests.judge.metrics.episodes import BEGIN, CAP_S, judged_flight


def test_the_view_is_twice_as_wide_as_deep_and_has_no_width_behind_or_after_the_cap():
    """The camera sees 90° across. The view has no width at a target behind or beside the camera."""
    seen = [
        (5.0, [10.0, 3.0, 1.0]),
        (10.0, [-10.0, 3.0, 1.0]),
        (15.0, [0.0, 3.0, 1.0]),
        (CAP_S + 1.0, [10.0, 3.0, 1.0]),
    ]
    decisions = [decision(step, step, t, None) for step, (t, _) in enumerate(seen)]
    truth = [frame(step, t - 0.5, 10.0, target_frd=there) for step, (t, there) in enumerate(seen)]
    widths = view_width(judged_flight((decisions, [BEGIN, *truth], None), None))
    assert widths == [pytest.approx(20.0), None, None, None]
