"""Tests that each pilot that fails on purpose shows its failure in the logged truth of a flight."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.reply.reading import reading
from dronecats.flight.spec.flight_spec import Connected, FlightSpec, Simulated
from dronecats.judge.judged_flight import JudgedFlight, outcome
from dronecats.judge.metrics.failure_mode import failure_mode
from dronecats.pilots import roster
from dronecats.pilots.oracle import failing
from foundation.errors import UsageError
from foundation.protocol import FINISHED, GO, RADIUS_M, THINK
from foundation.run_folder.reading import Logs, read
from foundation.run_folder.results import Verdict
from foundation.run_folder.rows import FrameTruth

ALONE, FLEET = "residential-approaching-03", "residential-commanding-02"
SECONDS = {  # enough for each pilot to show its failure
    "declares-at-once": 6, "declares-early": 45, "never-declares": 60, "oscillates": 45, "never-grounds": 60,
    "never-closes": 15, "one-point": 20, "leaves-the-protocol": 30,
}  # fmt: skip
NAMES = sorted(failing.FAILURES)


@dataclass(frozen=True)
class FailedFlight:
    """A flight of a failing pilot."""

    logs: Logs
    verdict: Verdict
    folder: Path

    @property
    def kinds(self) -> list[str | None]:
        return [d.kind for d in self.logs.decisions]

    def truth(self, step: int, drone: int = 0) -> FrameTruth:
        """Return the truth at the frame of a step."""
        return next(
            self.logs.frames[drone, d.frame_id] for d in self.logs.decisions if (d.step, d.drone) == (step, drone)
        )

    def distances(self, drone: int = 0) -> list[float]:
        """Return the distance at each step's frame, m."""
        steps = [d.step for d in self.logs.decisions if d.drone == drone]
        return [m for step in steps if (m := self.truth(step, drone).distance_m) is not None]


@pytest.fixture(scope="module")
def failed_flight(fly_once):
    """Return a function (name) → flight of the failing pilot, in lockstep without rendering. Each flies once."""
    flights: dict[str, FailedFlight] = {}

    def of(name: str) -> FailedFlight:
        if name not in flights:
            episode = FLEET if name == "one-point" else ALONE
            spec = FlightSpec(
                episode=episode, pilot=f"failing:{name}", simulated=Simulated(speed=None, rendered=False),
                latency=LatencyPolicy.parse("fixed:0.1"), seconds=SECONDS[name], full=True,
            )  # fmt: skip
            folder = fly_once(spec).run / episode
            logs = read(folder)
            flights[name] = FailedFlight(logs, outcome(logs), folder)
        return flights[name]

    return of


def turned_away(bearing_deg: float | None, x: float) -> float:
    """Return the horizontal distance of a commanded point from the target, in 1/1000 of the picture's width."""
    return abs(500.0 + 500.0 * math.tan(math.radians(bearing_deg or 0.0)) - x)


def test_declares_at_once_declares_in_its_first_step(failed_flight):
    flight = failed_flight("declares-at-once")
    assert flight.kinds[0] == FINISHED
    assert set(flight.kinds[1:]) == {THINK}
    assert min(flight.distances()) > 3.0 * RADIUS_M
    assert (flight.verdict.outcome, flight.verdict.declarations, flight.verdict.false_declarations) == ("failure", 1, 1)


def test_declares_early_declares_at_1_3_of_the_start_distance(failed_flight):
    flight = failed_flight("declares-early")
    first = flight.kinds.index(FINISHED)
    assert 1.25 <= flight.distances()[first] / flight.distances()[0] <= 1.35
    assert flight.kinds.count(FINISHED) == 1
    assert flight.verdict.outcome == "failure"


def test_never_declares_arrives_without_a_declaration(failed_flight):
    flight = failed_flight("never-declares")
    assert min(flight.distances()) <= RADIUS_M
    assert flight.distances()[-1] <= RADIUS_M
    assert flight.truth(len(flight.kinds) - 1).visible
    assert flight.verdict.declarations == 0
    assert flight.verdict.diagnostics is not None
    assert flight.verdict.diagnostics.oracle_success
    assert flight.verdict.outcome == "failure"


def test_oscillates_flies_back_and_forth(failed_flight):
    flight = failed_flight("oscillates")
    diagnostics = flight.verdict.diagnostics
    assert diagnostics is not None
    assert diagnostics.path_m > 5.0 * (flight.distances()[0] - min(flight.distances()))
    assert all(abs(m - flight.distances()[0]) < 4.0 for m in flight.distances())
    strides = [flight.truth(step).position_ned for step, kind in enumerate(flight.kinds) if kind == GO]
    assert len(strides) > 6
    assert all(
        sum((a - b) ** 2 for a, b in zip(here, later, strict=True)) < 1.0
        for here, later in zip(strides[::2], strides[2::2], strict=False)
        if here and later
    )


def test_never_grounds_never_points_near_the_target(failed_flight):
    flight = failed_flight("never-grounds")
    seen = 0
    for decision in flight.logs.decisions:
        truth, action = flight.truth(decision.step), decision.action or {}
        if decision.kind == GO and truth.visible:
            seen += 1
            assert turned_away(truth.bearing_deg, action["point"][0]) > 400.0
    assert seen >= 2
    assert min(flight.distances()) > RADIUS_M
    assert flight.verdict.declarations == 0


def test_never_closes_points_at_the_target_and_stays_away(failed_flight):
    flight = failed_flight("never-closes")
    for decision in flight.logs.decisions:
        assert decision.action is not None
        assert turned_away(flight.truth(decision.step).bearing_deg, decision.action["point"][0]) < 40.0
    assert max(abs(m - flight.distances()[0]) for m in flight.distances()) < 1.0
    assert flight.verdict.declarations == 0


def test_one_point_gives_four_drones_one_point(failed_flight):
    flight = failed_flight("one-point")
    steps: dict[int, list[object]] = {}
    for decision in flight.logs.decisions:
        steps.setdefault(decision.step, []).append(decision.action)
    complete = [actions for actions in steps.values() if len(actions) == 4]
    assert len(complete) > 5
    assert all(actions == [actions[0]] * 4 for actions in complete)
    going = [step for step in steps if flight.logs.decisions[4 * step].kind == GO]
    assert len(going) > 5
    true_bearings = [[flight.truth(step, drone).bearing_deg for drone in range(4)] for step in going[:3]]
    assert all(max(b or 0.0 for b in bearings) - min(b or 0.0 for b in bearings) > 5.0 for bearings in true_bearings)


def test_leaves_the_protocol_never_gives_an_action(failed_flight):
    flight = failed_flight("leaves-the-protocol")
    assert set(flight.kinds) == {None}
    assert all(decision.error for decision in flight.logs.decisions)
    assert len({decision.reply for decision in flight.logs.decisions}) == len(failing.NO_ACTIONS)
    assert flight.verdict.steps == len(flight.kinds) > 6
    for parser in ("strict", "lenient"):
        for text in failing.NO_ACTIONS:
            assert [parsed.action for drones in (1, 4) for parsed in reading(text, drones, "xy", parser)] == [None] * 5


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("declares-at-once", "declared"), ("declares-early", "declared"), ("never-declares", "arrived"),
        ("oscillates", "oscillated"), ("never-closes", "never closed"), ("leaves-the-protocol", "never closed"),
    ],
)  # fmt: skip
def test_failing_pilots_have_their_failure_mode(failed_flight, name, mode):
    flight = failed_flight(name)
    assert failure_mode(JudgedFlight(flight.folder, {}, flight.logs)) == mode


@pytest.mark.parametrize("name", NAMES)
def test_every_failing_pilot_is_registered_and_needs_the_truth(name):
    assert roster.check(f"failing:{name}") == f"failing:{name}"
    assert not roster.needs_pictures(f"failing:{name}")
    assert roster.needs_truth(f"failing:{name}")
    assert name in SECONDS
    from dronecats.flight.run.fly import fly

    spec = FlightSpec(
        connected=Connected(url="udpin://127.0.0.1:1", camera="x"), instruction="go", pilot=f"failing:{name}"
    )
    with pytest.raises(UsageError, match=name):
        fly(spec, None, print)


def test_an_unknown_name_is_rejected_and_the_nearest_is_suggested():
    near = NAMES[0]
    with pytest.raises(UsageError, match=f"'failing:{near}'"):
        roster.check(f"failing:{near[:-1]}")


def test_run_json_names_the_failing_pilot_and_no_model(failed_flight):
    flight = failed_flight("declares-at-once")
    fields = json.loads((flight.folder.parent / "run.json").read_text(encoding="utf-8"))["flight"]
    assert (fields["pilot"], fields["model"]) == ("failing:declares-at-once", None)
