"""A factor that has no effect on any flight is rejected before the first flight. No other factor is rejected."""

import pytest

from dronecats.bench.matrix import choose_suite
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.study import design
from dronecats.study.design import Axis
from dronecats.study.factors import FACTORS
from dronecats.study.plan import check_effects, plan
from foundation.errors import UsageError
from tests.study.test_factors import NEEDS, between

REAL_TIME = FlightSpec(pilot="oracle", simulated=Simulated(speed=1.0))


def check(varied, held=None, made=design.full):
    axes = [Axis(name=name, levels=tuple(levels)) for name, levels in varied.items()]
    plan(
        "mine", [("oracle", REAL_TIME)], choose_suite(["residential-approaching-01"], ()), made(axes), held=held or {},
        flights=1,
    )  # fmt: skip


def test_factors_without_an_effect_are_rejected_with_a_reason():
    for varied, held, parts in (
        ({"wind_towards": [0.0, 90.0]}, {"wind": 0.0}, "wind_towards .* wind .*0 "),
        ({"latency": [0.0, 1.0]}, {"wind": 0.0, "wind_towards": 9.0}, "wind_towards at 9 .* wind .*0 "),
        ({"jitter_rho": [0.0, 0.5]}, {"rate": 1.0, "jitter_cv": 0.0}, "jitter_rho .* jitter_cv .*0 "),
        ({"reply_stall_length": [1.0, 5.0]}, {"reply_stall_share": 0.0}, "_length .* reply_stall_share .*0 "),
        ({"reply_stall_share": [0.0, 0.5]}, {"reply_stall_length": 0.0}, "_share .* reply_stall_length .*0 "),
        ({"stall_length": [0.1, 0.5]}, {}, "stall_length .*stall_share .*0 "),
        ({"stall_share": [0.1, 0.5]}, {"stall_length": 0.0}, "stall_share .* stall_length .*0 "),
        ({"rate_cap": [1.0, 4.0]}, {"latency": 2.0}, "rate_cap .* 2 s.* 1 Hz"),
        ({"wind_towards": [0.0, 360.0]}, {"wind": 3.0}, "wind_towards at 0 .* 360 "),
    ):
        with pytest.raises(UsageError, match=parts):
            check(varied, held)


def test_one_at_a_time_is_rejected_if_the_refined_factor_is_off_at_its_first_level():
    turning = {"wind": [0.0, 6.0], "wind_towards": [0.0, 90.0]}
    with pytest.raises(UsageError, match=r"wind_towards .*levels.* wind .*0 "):
        check(turning, made=design.one_at_a_time)
    check({**turning, "wind": [6.0, 0.0]}, made=design.one_at_a_time)
    check(turning)  # some combinations have a wind with a direction


def test_a_rate_cap_without_effect_at_some_levels_is_accepted():
    check({"rate_cap": [0.1, 1.0, 4.0]}, {"rate": 1.0})


def test_factors_with_an_effect_are_accepted():
    """Each factor is alone or with the factor that it refines. The oracle accepts camera and link factors too."""
    for name in [name for name, factor in FACTORS.items() if factor.quantity]:
        needs = {**NEEDS.get(name, {}), **({"stall_share": 0.1} if name == "stall_length" else {})}
        needs |= {"rate": 2.0} if name.startswith("jitter") else {"latency": 0.0} if name == "rate_cap" else {}
        check({name: [between(FACTORS[name], share) for share in (0.125, 0.25, 0.5)]}, needs)


def test_an_empty_design_is_accepted():
    check_effects(REAL_TIME, (), {})
