"""Every factor sets only its own fields of a flight, within its range. The registry rejects everything else."""

import re
from collections.abc import Mapping

import pytest
from hypothesis import example, given, reject
from hypothesis import strategies as st

from dronecats.agent.latency import LatencyPolicy
from dronecats.flight.spec.disturbances import LEVELS
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_json, from_json
from dronecats.study.factors import FACTORS, at_levels, check_together, factor_of, level_text
from foundation.declaration import shown
from foundation.errors import UsageError
from foundation.run_folder.results import Level

FLIGHT = FlightSpec(pilot="oracle", simulated=Simulated(speed=1.0), latency=LatencyPolicy.parse("rate:2"))
NUMBERS = [factor for factor in FACTORS.values() if factor.quantity]
WORDS = {
    "pilot": "blind:ring", "model": "openai/gpt", "agent": "steady", "command": "solo", "latency_policy": "real",
    "sky": "overcast", "season": "autumn",
}  # fmt: skip
OTHER_WORDS = {
    "pilot": ["oracle", "noisy"], "model": ["openai/gpt", "openai/other"], "agent": ["paper", "steady"],
    "command": ["flat", "solo"], "latency_policy": ["fixed:1", "gamma:1,0.5", "lognormal:1,0.5", "measured"],
    "sky": ["clear", "overcast"], "season": ["summer", "autumn"],
}  # fmt: skip
NEEDS = {
    "jitter_rho": {"jitter_cv": 0.5},
    "reply_stall_length": {"reply_stall_share": 0.1},
    "wind_towards": {"wind": 4.0},
}
# the place of each factor in a flight's JSON; a link factor has one per direction
PLACES = {
    "pilot": ["pilot"], "model": ["pilot", "model"], "agent": ["agent"], "command": ["command"],
    "latency": ["latency"], "latency_policy": ["latency"], "rate": ["latency"], "jitter_cv": ["latency"],
    "jitter_rho": ["latency"], "rate_cap": ["latency"], "reply_stall_share": ["latency"],
    "reply_stall_length": ["latency"],
    **{level.name: [f"disturbances.{part}.{field}"] for part, field, level in LEVELS if part != "link"},
    **{
        f"link_{name}": [f"disturbances.link.{way}.{field}" for way in ("to_vehicle", "from_vehicle")]
        for name, field in (("delay", "delay_s"), ("jitter", "jitter_s"), ("loss", "loss"), ("baud", "baud"),
                            ("duplicate", "duplicate"), ("reorder", "reorder"))
    },
}  # fmt: skip


def between(factor, share):
    """Return the level at a share of a factor's range."""
    low, high = factor.quantity.low, factor.quantity.high
    value = low + (high - low) * share
    return factor.level(round(value) if factor.quantity.whole else value)


def flat(value, path=""):
    if isinstance(value, dict):
        return {k: v for key, child in value.items() for k, v in flat(child, f"{path}.{key}" if path else key).items()}
    return {path: value}


def test_a_factor_changes_only_its_own_fields():
    for name in FACTORS:
        factor = FACTORS[name]
        base = at_levels(FLIGHT, NEEDS.get(name, {}))
        level = between(factor, 0.125) if factor.quantity else factor.level(WORDS[name])
        flight = at_levels(FLIGHT, {**NEEDS.get(name, {}), name: level})
        before, after = flat(as_json(base)), flat(as_json(flight))
        moved = [key for key in {**before, **after} if before.get(key) != after.get(key)]
        assert moved, name
        assert all(any(key == place or key.startswith(f"{place}.") for place in PLACES[name]) for key in moved), name
        assert {place for place in PLACES[name] for key in moved if key == place or key.startswith(f"{place}.")} == set(
            PLACES[name]
        ), name
        assert from_json(as_json(flight), "it") == flight, name


@st.composite
def levels_twice(draw):
    """Draw two sets of levels for the same compatible factors."""
    wanted = draw(st.lists(st.sampled_from(list(FACTORS)), min_size=1, max_size=5, unique=True))
    names: list[str] = []
    for name in (needed for factor in wanted for needed in (*NEEDS.get(factor, {}), factor)):
        if name not in names and FACTORS[name].sets not in {FACTORS[chosen].sets for chosen in names}:
            names.append(name)
    if "rate" not in names and {"latency", "latency_policy"} & {*names}:
        names = [name for name in names if not name.startswith("jitter")]
    return [{name: level_of(draw, FACTORS[name]) for name in names} for _ in range(2)]


def level_of(draw, factor):
    if factor.quantity:
        return between(factor, draw(st.floats(0.0, 1.0)))
    return factor.level(draw(st.sampled_from(OTHER_WORDS[factor.name])))


def same_twice(name):
    """Return the levels at both ends of a factor's range, each with the factors that it needs."""
    factor = FACTORS[name]
    ends = (factor.quantity.low, factor.quantity.high) if factor.quantity else OTHER_WORDS[name][:2]
    return tuple({**NEEDS.get(name, {}), name: factor.level(end)} for end in ends)


@given(levels_twice(), st.sampled_from([FLIGHT, at_levels(FLIGHT, {"rate_cap": 1.0, "reply_stall_share": 0.5})]))
@example(({"wind": 6.0, "wind_towards": 0.0}, {"wind": 6.0, "wind_towards": 30.0}), FLIGHT)
@example(({"wind": 0.0, "wind_towards": 90.0}, {"wind": 7.0, "wind_towards": 45.0}), FLIGHT)
@example(({"frame_delay": 1.0, "frame_rate": 0.1}, {"frame_delay": 14.0, "frame_rate": 10.0}), FLIGHT)
@example(({"rate_cap": 0.5, "reply_stall_share": 0.5}, {"rate_cap": 2.0, "reply_stall_share": 0.0}), FLIGHT)
def test_new_levels_replace_the_earlier_levels_completely(twice, flight):
    check_nothing_is_left(twice, flight)


def test_a_new_level_of_any_single_factor_replaces_the_earlier_one_completely():
    for name in FACTORS:
        check_nothing_is_left(same_twice(name), FLIGHT)


def check_nothing_is_left(twice, flight):
    first, second = twice
    try:
        at_first, at_second = at_levels(flight, first), at_levels(flight, second)
    except UsageError as contradiction:
        if not re.search("period|dusk", str(contradiction)):  # a delay and a period, the sun at dusk
            raise
        reject()
    assert at_levels(at_first, first) == at_first
    assert at_levels(at_first, second) == at_second


def test_levels_at_the_ends_of_a_range_are_accepted_and_levels_beyond_are_rejected():
    for factor in NUMBERS:
        assert factor.quantity
        low, high = factor.quantity.low, factor.quantity.high
        for end in (low, high):
            flight = at_levels(FLIGHT, {**NEEDS.get(factor.name, {}), factor.name: factor.level(end)})
            assert LatencyPolicy.parse(str(flight.latency)) == flight.latency, factor.name  # `parse` checks the bounds
        for beyond in (low - 0.01, high + 1, "much", None, True, [1], float("nan")):
            with pytest.raises(UsageError, match=f"^{factor.name} .*{re.escape(shown(high))}"):
                factor.level(beyond)


def test_the_ranges_of_the_registry_are_within_those_of_the_flight():
    """The registry rejects every number that a flight rejects. No point of a design fails only by its number."""
    for factor in NUMBERS:
        for share in (0.0, 0.3, 0.7, 1.0):
            at_levels(FLIGHT, {**NEEDS.get(factor.name, {}), factor.name: between(factor, share)})


def test_reply_times_are_written_as_a_policy():
    for levels, policy in (
        ({"latency": 0.25}, "fixed:0.25"),
        ({"latency": 4.0}, "fixed:4"),
        ({"rate": 2.0}, "rate:2"),
        ({"jitter_cv": 0.5}, "jitter:2,0.5"),
        ({"rate": 0.5, "jitter_cv": 0.0}, "jitter:0.5,0"),
        ({"jitter_rho": 0.9, "jitter_cv": 1.0, "rate": 3.0}, "jitter:3,1,0.9"),  # written in the registry's order
        ({"latency_policy": "lognormal:0.5,0.6"}, "lognormal:0.5,0.6"),
        ({"reply_stall_length": 20.0, "reply_stall_share": 0.1, "latency": 1.0}, "fixed:1+stall:0.1,20"),
        ({"reply_stall_share": 0.1, "jitter_cv": 1.0, "rate_cap": 2.0}, "jitter:2,1+cap:2+stall:0.1,1"),
    ):
        assert str(at_levels(FLIGHT, levels).latency) == policy, levels


@given(st.floats(0.1, 30.0), st.integers(0, 360))
@example(30.0, 1)
def test_the_wind_speed_is_the_same_in_every_direction(speed, towards):
    wind = at_levels(FLIGHT, {"wind_towards": float(towards), "wind": speed}).disturbances.vehicle.wind_ned
    assert sum(part**2 for part in wind) ** 0.5 == pytest.approx(speed, abs=3e-6)
    assert wind[2] == 0.0
    east = at_levels(FLIGHT, {"wind": 5.0, "wind_towards": 90.0}).disturbances.vehicle.wind_ned
    assert east == (0.0, 5.0, 0.0)


def test_only_pilots_that_use_pictures_get_them_rendered():
    blind = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False))
    for name, seen in (("oracle", False), ("vision", True)):
        for before in (blind, at_levels(blind, {"pilot": "vision"})):  # after any other pilot
            flight = at_levels(before, {"pilot": name})
            assert flight.simulated is not None
            assert flight.simulated.rendered is seen


def test_contradictory_levels_are_rejected_with_their_factor():
    cases: list[tuple[Mapping[str, Level], str]] = [
        ({"jitter_rho": 0.5}, "jitter_rho .*0.5.* jitter_cv"),
        ({"reply_stall_length": 0.5}, "reply_stall_length .*0.5.* reply_stall_share"),
        ({"latency": 1.0, "jitter_cv": 0.5}, "jitter_cv .*0.5.* rate"),
        ({"latency_policy": "soon"}, "latency_policy .*soon.* --latency "),
        ({"wind_towards": 30.0}, r"wind_towards .*30.* wind\b"),
        ({"latency_policy": "fixed:1+cap:2", "rate_cap": 1.0}, r"rate_cap .*latency_policy .*cap\b"),
        ({"pilot": "orakel"}, "pilot .*orakel.*oracle"),
    ]
    for levels, parts in cases:
        with pytest.raises(UsageError, match=parts):
            at_levels(FLIGHT, levels)


def test_a_stalled_host_is_rejected_in_lockstep():
    lockstep = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False))
    with pytest.raises(UsageError, match=r"stall_share .*--speed"):
        at_levels(lockstep, {"stall_share": 0.1})


@pytest.mark.parametrize("pair", [("latency", "rate"), ("rate", "latency_policy"), ("pilot", "model")])
def test_two_factors_with_the_same_meaning_are_rejected(pair):
    with pytest.raises(UsageError, match=f"{pair[0]} .*{pair[1]}"):
        check_together(list(pair))
    check_together(["rate", "jitter_cv", "jitter_rho", "wind", "wind_towards"])


def test_an_unknown_factor_is_rejected_with_the_nearest_name():
    with pytest.raises(UsageError, match=r"'latancy'.*\blatency\b"):
        factor_of("latancy")
    assert factor_of("frame-delay") is FACTORS["frame_delay"]


@given(st.floats(0.0, 300.0))
def test_the_text_of_a_level_parses_to_the_same_number(number):
    assert float(level_text(number)) == pytest.approx(number, rel=1e-11)


def test_unknown_words_are_rejected():
    with pytest.raises(UsageError, match=r"command .*flat, hierarchical, solo.*'loud'"):
        FACTORS["command"].level("loud")
    with pytest.raises(UsageError, match=r"agent .*3"):
        FACTORS["agent"].level(3)
