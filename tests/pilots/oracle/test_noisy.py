"""Tests the oracle with the vision pilot's errors: its detections, its random draws, and its error sizes."""

import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.pilots import roster
from dronecats.pilots.oracle import noisy, oracle
from dronecats.pilots.oracle.noisy import Attention, DetectionErrors, NoisyPilot, VisionErrors
from dronecats.pilots.oracle.oracle import TrueState
from dronecats.report.report_data import pilot_description
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import quat_from_euler
from foundation.protocol import FINISHED, GO, ROTATE, THINK

PAINT = "go to the red car"
PERFECT = Attention(found=(1.0,) * 3, kept=(1.0,) * 3, strays=0.0, stays=0.0, claims=0.0)
BLIND = replace(PERFECT, found=(0.0,) * 3, kept=(0.0,) * 3)
SURE = DetectionErrors(
    flights=1, mistaken=0.0, sure=PERFECT, lost=BLIND, aside_px=0.0, above_px=0.0, depth=0.0, depth_flight=0.0,
    depth_step=0.0, astray_m=10.0, astray=0.5,
)  # fmt: skip


def errors(eye: DetectionErrors) -> VisionErrors:
    return VisionErrors(fitted_to="nothing", code_sha256="", eyes={"paint": eye, "place": eye, "inscription": eye})


def pilot(eye: DetectionErrors = SURE, seed=(7, 0), instruction=PAINT) -> NoisyPilot:
    return NoisyPilot(instruction, seed, errors(eye))


def sight(target, *, step=0, drone=0, visible=True, yaw=0.0) -> TrueState:
    attitude = quat_from_euler(0.0, 0.0, yaw)
    return TrueState((0.0, 0.0, -1.5), yaw, attitude, target, (0.0, 0.0, 0.0), CameraModel(), drone, step, visible)


def action(reply: str):
    return json.loads(reply)


@given(north=st.floats(8.0, 40.0), aside=st.floats(-0.9, 0.9))
def test_without_errors_it_approaches_like_the_oracle(north, aside):
    seen = sight((north, aside * north, -0.8))
    assert pilot()([seen]) == oracle.next_action(seen)


def test_it_declares_by_its_estimated_distance():
    at = sight((4.9, 0.0, -1.4))
    assert action(pilot()([at]))["action"] == GO
    assert action(pilot(replace(SURE, depth=-0.3))([at]))["action"] == FINISHED  # estimated to be nearer
    near = sight((4.2, 0.0, -1.4))
    assert action(pilot()([near]))["action"] == FINISHED
    assert action(pilot(replace(SURE, depth=0.3))([near]))["action"] == GO


@given(here=st.tuples(st.floats(-40, 40), st.floats(-40, 40)), there=st.tuples(st.floats(-40, 40), st.floats(-40, 40)))
def test_replies_do_not_depend_on_a_target_outside_the_picture(here, there):
    """Compares two target positions with the same random draws, for a full search with strays and claims."""
    eye = replace(SURE, sure=replace(PERFECT, strays=0.3, stays=0.7, claims=0.1))
    first, second = pilot(eye), pilot(eye)
    for step in range(20):
        replies = [p([sight((*at, -0.8), step=step, visible=False)]) for p, at in ((first, here), (second, there))]
        assert replies[0] == replies[1]


def test_it_turns_a_full_circle_and_then_flies_to_another_place():
    kinds = []
    noisy_pilot = pilot()
    for step in range(8):
        kinds.append(action(noisy_pilot([sight((10.0, 0.0, -0.8), step=step, visible=False)]))["action"])
    assert kinds == [ROTATE] * 5 + [GO] * 3


def test_a_draw_depends_on_seed_step_and_drone_only():
    eye = replace(SURE, aside_px=30.0, depth_step=0.3)
    far = (25.0, 2.0, -0.8)
    late = pilot(eye)
    for step in range(6):
        late([sight((20.0 + step, 1.0, -0.8), step=step)])
    assert late([sight(far, step=6)]) == pilot(eye)([sight(far, step=6)])
    others = {
        pilot(eye)([sight(far, step=5)]), pilot(eye)([sight(far, step=6, drone=1)]),
        pilot(eye, (7, 1))([sight(far, step=6)]), pilot(eye, (8, 0))([sight(far, step=6)]),
    }  # fmt: skip
    assert len(others | {pilot(eye)([sight(far, step=6)])}) == 5


@pytest.mark.parametrize(("distance_m", "band"), [(6.5, 0), (12.0, 1), (30.0, 2)])
def test_it_misses_as_often_as_configured(distance_m, band):
    shares_found = (0.2, 0.5, 0.8)
    eye = replace(SURE, sure=replace(PERFECT, found=shares_found))
    replies = [pilot(eye, (k, 0))([sight((distance_m, 0.0, -0.8))]) for k in range(1500)]
    share = sum(action(reply)["action"] != ROTATE for reply in replies) / len(replies)
    assert share == pytest.approx(shares_found[band], abs=3.0 * math.sqrt(0.25 / len(replies)))


def test_its_errors_have_the_configured_spread():
    eye = replace(SURE, aside_px=20.0, depth=0.1, depth_flight=0.12, depth_step=0.05)
    x, depth = [], []
    for flight in range(300):
        noisy_pilot, flight_depths = pilot(eye, (flight, 3)), []
        for step in range(4):
            go = action(noisy_pilot([sight((20.5, 0.0, -1.4), step=step)]))
            x.append(1.28 * go["point"][0] - 640.0)
            flight_depths.append(math.log(go["depth_m"] / 20.0))
        depth.append(flight_depths)
    assert (sum(v * v for v in x) / len(x)) ** 0.5 == pytest.approx(20.0, rel=0.08)
    means = [sum(t) / 4 for t in depth]
    mean = sum(means) / len(means)
    between = (sum((m - mean) ** 2 for m in means) / len(means)) ** 0.5
    within = (sum((v - m) ** 2 for t, m in zip(depth, means, strict=True) for v in t) / (3 * len(means))) ** 0.5
    assert mean == pytest.approx(0.1, abs=0.02)
    assert between == pytest.approx(math.hypot(0.12, 0.05 / 2), rel=0.12)
    assert within == pytest.approx(0.05, rel=0.08)


def test_a_flight_is_mistaken_in_all_steps_and_as_often_as_configured():
    eye = replace(SURE, mistaken=0.3)
    saw = []
    for flight in range(600):
        noisy_pilot = pilot(eye, (flight, 0))
        kinds = {action(noisy_pilot([sight((20.0, 0.0, -0.8), step=step)]))["action"] == GO for step in range(4)}
        assert len(kinds) == 1
        saw.append(kinds.pop())
    assert saw.count(False) / len(saw) == pytest.approx(0.3, abs=0.06)


def test_after_a_failed_claim_it_comes_nearer_and_claims_again():
    noisy_pilot = pilot()
    kinds = [action(noisy_pilot([sight((4.2, 0.0, -1.4), step=step)]))["action"] for step in range(4)]
    assert kinds == [FINISHED, GO, FINISHED, GO]


def test_a_wrong_target_is_approached_and_claimed():
    eye = replace(SURE, sure=replace(BLIND, strays=1.0, stays=0.0, claims=1.0))
    noisy_pilot = pilot(eye)
    kinds = [action(noisy_pilot([sight((20.0, 0.0, -0.8), step=step)]))["action"] for step in range(3)]
    assert kinds == [GO, FINISHED, ROTATE]


def test_only_the_nearest_drone_of_a_fleet_flies():
    replies = json.loads(pilot()([sight((30.0, 0.0, -0.8)), sight((20.0, 0.0, -0.8), drone=1)]))
    assert [reply["action"] for reply in replies] == [THINK, GO]


def test_a_command_selects_the_errors_of_its_detector():
    assert noisy.named_by(PAINT) == "paint"
    assert noisy.named_by("go to the bench left of the fountain") == "place"
    assert noisy.named_by("go to the sign that reads WEST") == "inscription"


def test_the_shipped_errors_have_valid_shares_and_spreads():
    shipped = noisy.shipped_errors()
    assert set(shipped.eyes) == {"paint", "place", "inscription"}
    assert sum(eye.flights for eye in shipped.eyes.values()) == 100
    for eye in shipped.eyes.values():
        shares = [eye.mistaken]
        for attention in (eye.sure, eye.lost):
            shares += [*attention.found, *attention.kept, attention.strays, attention.stays, attention.claims]
            assert attention.stays + attention.claims <= 1.0
        assert all(0.0 <= share <= 1.0 for share in shares)
        assert min(eye.sure.kept) > max(eye.lost.found)
        assert all(0.0 < spread < 1.0 for spread in (eye.depth_step, eye.depth_flight))


def test_noisy_is_a_built_in_pilot():
    assert roster.check("noisy") == "noisy"
    assert roster.needs_truth("noisy")
    assert not roster.needs_pictures("noisy")
    assert pilot_description("noisy")
    with pytest.raises(UsageError, match="noisy"):
        roster.check("noisi")


def test_a_flight_repeats_with_its_seed_and_changes_with_another(tmp_path):
    from dronecats.flight.run.fly import fly

    logs = []
    for k, seed in enumerate((0, 0, 1)):
        spec = FlightSpec(
            episode="residential-approaching-03", pilot="noisy", seed=seed, seconds=8.0, full=True,
            simulated=Simulated(speed=None, rendered=False),
        )  # fmt: skip
        fly(spec, tmp_path / str(k), lambda line: None)
        folder = next((tmp_path / str(k)).glob("*/decisions.jsonl")).parent
        logs.append([(folder / name).read_bytes() for name in ("decisions.jsonl", "truth.jsonl")])
    assert logs[0] == logs[1]
    assert logs[0][0] != logs[2][0]
