"""A factor that says nothing of any flight is refused before one is flown, and no other is."""

import pytest

from dronecats.campaign.matrix import suite_of
from dronecats.flight.spec import FlightSpec, Simulated
from dronecats.study import design, mute
from dronecats.study.design import Axis
from dronecats.study.factors import FACTORS
from dronecats.study.plan import plan
from foundation.errors import UsageError
from tests.study.test_factors import NEEDS, between

REAL_TIME = FlightSpec(pilot="oracle", simulated=Simulated(speed=1.0))


def check(varied, held=None, made=design.full):
    axes = [Axis(name=name, levels=tuple(levels)) for name, levels in varied.items()]
    plan(
        "mine", [("oracle", REAL_TIME)], suite_of(["residential-approaching-01"], ()), made(axes), held=held or {},
        flights=1,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("varied", "held", "sentence"),
    [
        ({"wind_towards": [0.0, 90.0]}, {"wind": 0.0}, "wind_towards says nothing in every flight: wind is 0 there"),
        ({"latency": [0.0, 1.0]}, {"wind": 0.0, "wind_towards": 9.0}, "wind_towards at 9 says nothing in every flight"),
        ({"jitter_rho": [0.0, 0.5]}, {"rate": 1.0, "jitter_cv": 0.0}, "jitter_rho says nothing .*: jitter_cv is 0"),
        (
            {"reply_stall_length": [1.0, 5.0]},
            {"reply_stall_share": 0.0},
            "reply_stall_length says .*: reply_stall_share is 0 there",
        ),
        (
            {"reply_stall_share": [0.0, 0.5]},
            {"reply_stall_length": 0.0},
            "reply_stall_share says nothing in every flight: reply_stall_length is 0",
        ),
        ({"stall_length": [0.1, 0.5]}, {}, "stall_length says nothing in every flight: stall_share is 0 there; vary"),
        ({"stall_share": [0.1, 0.5]}, {"stall_length": 0.0}, "stall_share says nothing .*: stall_length is 0 there"),
        (
            {"rate_cap": [1.0, 4.0]},
            {"latency": 2.0},
            "rate_cap says nothing in every flight: every reply takes 2 s there, and 1 Hz holds none of those back",
        ),
        ({"wind_towards": [0.0, 360.0]}, {"wind": 3.0}, "wind_towards at 0 and at 360 is one and the same flight"),
    ],
)
def test_what_says_nothing_is_told_with_its_reason(varied, held, sentence):
    with pytest.raises(UsageError, match=sentence):
        check(varied, held)


def test_where_only_one_factor_moves_at_a_time_what_it_refines_is_at_its_first_level():
    turning = {"wind": [0.0, 6.0], "wind_towards": [0.0, 90.0]}
    with pytest.raises(UsageError, match="wind_towards says nothing at all of its levels but one: wind is 0 there"):
        check(turning, made=design.one_at_a_time)
    check({**turning, "wind": [6.0, 0.0]}, made=design.one_at_a_time)
    check(turning)  # of all combinations some have a wind that is turned


def test_a_cap_that_holds_nothing_back_is_what_the_others_are_compared_with():
    check({"rate_cap": [0.1, 1.0, 4.0]}, {"rate": 1.0})


@pytest.mark.parametrize("name", [name for name, factor in FACTORS.items() if factor.numeric])
def test_what_says_something_is_flown(name):
    """Alone, or beside what it refines: at any of its levels, pictures and wires of a pilot that looks at none too."""
    needs = {**NEEDS.get(name, {}), **({"stall_share": 0.1} if name == "stall_length" else {})}
    needs |= {"rate": 2.0} if name.startswith("jitter") else {"latency": 0.0} if name == "rate_cap" else {}
    check({name: [between(FACTORS[name], share) for share in (0.125, 0.25, 0.5)]}, needs)


def test_nothing_is_no_study():
    mute.check(REAL_TIME, (), {})
