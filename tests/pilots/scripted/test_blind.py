"""Tests the blind pilots: their replies do not depend on pictures and follow the documented pattern."""

import itertools
import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.agent.action import ActionError, Finished, Go, Rotate
from dronecats.agent.controller import plan
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.prompt import Prompt
from dronecats.agent.reply.strict import parse, parse_fleet
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.pilots import roster
from dronecats.pilots import scripted as blind
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.protocol import RADIUS_M
from foundation.setpoints import Turn, Velocity

UNDRAWN = Simulated(speed=None, rendered=False)
NAMES = sorted(blind.PATTERNS)
PROMPT = Prompt.load().render("go to the cyan SUV", "", 5)


def first(name: str, steps: int, prompt: str = PROMPT, pictures: tuple[bytes, ...] = (b"",)) -> list[str]:
    fly = roster.answer(f"blind:{name}")
    return [fly(prompt, list(pictures)) for _ in range(steps)]


def walked(name: str, steps: int) -> list[tuple[float, float, float, bool]]:
    """Return (north, east, heading in rad, whether it declares) at each step of a flight that starts northwards."""
    north = east = heading = 0.0
    track = []
    for text in first(name, steps):
        action = parse(text)
        track.append((north, east, heading, isinstance(action, Finished)))
        for segment in plan(action, CameraModel()):
            match segment.setpoint:
                case Turn():
                    heading += segment.setpoint.yaw_rate * segment.duration_s
                case Velocity():
                    ahead = segment.setpoint.forward * segment.duration_s
                    north, east = north + ahead * math.cos(heading), east + ahead * math.sin(heading)
    return track


@pytest.mark.parametrize("name", NAMES)
@given(pictures=st.lists(st.lists(st.binary(max_size=40), min_size=2, max_size=2), min_size=2, max_size=2))
@settings(max_examples=10, deadline=None)
def test_no_reply_changes_with_the_picture(name: str, pictures: list[list[bytes]]) -> None:
    replies = []
    for frames in pictures:
        fly = roster.answer(f"blind:{name}")
        replies.append([fly(PROMPT, [frame]) for frame in itertools.islice(itertools.cycle(frames), 60)])
    assert replies[0] == replies[1] == first(name, 60)


def test_no_reply_changes_with_the_prompt_of_a_later_step() -> None:
    for name in NAMES:
        fly = roster.answer(f"blind:{name}")
        texts = [fly(PROMPT if k == 0 else f"Command: go {k}", [b""]) for k in range(40)]
        assert texts == first(name, 40), name


def test_every_reply_is_an_action_for_one_drone_and_for_a_fleet() -> None:
    for name in NAMES:
        for text in first(name, 200):
            action = parse(text)
            assert not isinstance(action, Rotate) or abs(action.angle_deg) <= 90.0, name
            assert not isinstance(action, Go) or action.depth_m >= 2.0, name  # below 2 m a drone brakes
        for text in first(name, 30, pictures=(b"",) * 4):
            assert not any(isinstance(parsed, ActionError) for parsed in parse_fleet(text, 4)), name


def test_every_pattern_has_its_description_and_name() -> None:
    for name in NAMES:
        assert blind.PATTERNS[name].description in roster.owner(f"blind:{name}"), name
        assert roster.check(f"blind:{name}") == f"blind:{name}", name


def test_an_unknown_name_is_rejected_and_the_nearest_is_suggested() -> None:
    with pytest.raises(UsageError, match="spiral'"):
        roster.check("blind:spirall")
    with pytest.raises(UsageError):
        roster.check("spiral")


def test_only_pilots_without_vision_fly_without_rendering() -> None:
    for pilot in ("oracle", "blind", "blind:straight"):
        assert look_up(FlightSpec(pilot=pilot, simulated=UNDRAWN)).camera is None
    model = ModelSpec(provider="local", name="blind:straight", base_url="http://127.0.0.1:9/v1")
    for spec in (FlightSpec(pilot="vision", simulated=UNDRAWN), FlightSpec(model=model, simulated=UNDRAWN)):
        with pytest.raises(UsageError, match="rendering"):
            look_up(spec)


def test_random_repeats_for_one_command_and_differs_for_another() -> None:
    assert first("random", 50) == first("random", 50)
    assert first("random", 50) != first("random", 50, prompt=PROMPT.replace("cyan", "red"))


def test_straight_goes_straight_and_declares_after_every_stride() -> None:
    track = walked("straight", 40)
    assert all(east == pytest.approx(0.0) for _, east, _, _ in track)
    assert [declares for *_, declares in track] == [k % 2 == 1 for k in range(40)]
    assert track[-1][0] == pytest.approx(20 * 1.2)


def test_patterns_with_a_distance_declare_only_at_possible_targets() -> None:
    for name in ("straight-16", "right-90-16", "back-16", "arc", "ring"):
        claims = [math.hypot(n, e) for n, e, _, declares in walked(name, 20) if declares]
        assert claims
        assert all(blind.START_M - RADIUS_M <= far <= blind.START_M + RADIUS_M for far in claims)


def test_three_claims_of_the_arc_cover_the_view_of_the_first_frame() -> None:
    """At one claim, a target 16 m away within 35° of the nose is within 5 m and in view, except in small gaps."""
    claims = [step for step in walked("arc", 40) if step[3]][:3]
    assert len(claims) == 3
    missed = []
    for bearing in range(-35, 36):
        goal = (16.0 * math.cos(math.radians(bearing)), 16.0 * math.sin(math.radians(bearing)))
        met = any(
            math.dist((n, e), goal) <= 5.0
            and abs(math.remainder(math.atan2(goal[1] - e, goal[0] - n) - heading, 2 * math.pi)) < math.radians(45.0)
            for n, e, heading, _ in claims
        )
        missed += [] if met else [bearing]
    assert len(missed) <= 12


def test_ring_flies_a_full_circle() -> None:
    track = walked("ring", 100)
    around = [math.degrees(math.atan2(e, n)) % 360.0 for n, e, _, _ in track if math.hypot(n, e) > 10.0]
    assert len({int(a // 30) for a in around}) == 12
    assert all(13.0 < math.hypot(n, e) < 17.0 for n, e, _, declares in track if declares)


def test_a_fleet_fans_out() -> None:
    rotations = [json.loads(text)[k] for text in first("straight", 1, pictures=(b"",) * 4) for k in range(4)]
    assert [rotation["angle_deg"] for rotation in rotations] == [-33.8, -11.2, 11.2, 33.8]
