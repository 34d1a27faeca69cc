"""An action of the numeric space becomes a reply, and the parser reads the same numbers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.reply.reading import reading
from dronecats.bench.harnesses.outside_flight import KINDS, reply


@given(
    st.sampled_from(range(len(KINDS))),
    st.tuples(st.floats(0, 1000), st.floats(0, 1000)),
    st.floats(0.1, 300),
    st.floats(-90, 90),
)
def test_every_action_of_the_space_survives_the_strict_parser(kind, point, depth_m, angle_deg):
    (entry,) = reading(reply(kind, point, depth_m, angle_deg), 1, "xy", "strict")
    assert entry.action is not None, entry
    fields = entry.action.as_json()
    assert fields["action"] == KINDS[kind]
    if fields["action"] == "go":
        assert fields["point"] == pytest.approx(list(point))
        assert fields["depth_m"] == pytest.approx(depth_m)
    if fields["action"] == "rotate":
        assert fields["angle_deg"] == pytest.approx(angle_deg)


def test_an_unknown_kind_is_rejected():
    with pytest.raises(ValueError, match=r"0 .*3, .*4"):
        reply(4, (0, 0), 1, 0)
