"""The pilots that fail on purpose: each flown, and its failure found in what the logger wrote of the truth."""

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
from foundation.protocol import FINISHED, GO, RADIUS_M, ROTATE, THINK
from foundation.run_folder.reading import Logs, read
from foundation.run_folder.results import Verdict
from foundation.run_folder.rows import FrameTruth

ALONE, FLEET = "residential-approaching-03", "residential-commanding-02"
SECONDS = {  # enough for each to show what it does
    "declares-at-once": 6, "declares-early": 45, "never-declares": 60, "oscillates": 45, "never-grounds": 60,
    "never-closes": 15, "one-point": 20, "leaves-the-protocol": 30,
}  # fmt: skip
NAMES = sorted(failing.FAILURES)


@dataclass(frozen=True)
class Failed:
    """A flight of one of them."""

    logs: Logs
    verdict: Verdict
    folder: Path

    @property
    def kinds(self) -> list[str | None]:
        return [d.kind for d in self.logs.decisions]

    def truth(self, step: int, drone: int = 0) -> FrameTruth:
        """Return what was true at the frame of a step."""
        return next(
            self.logs.frames[drone, d.frame_id] for d in self.logs.decisions if (d.step, d.drone) == (step, drone)
        )

    def distances(self, drone: int = 0) -> list[float]:
        """Return the distance at each step's frame, m."""
        steps = [d.step for d in self.logs.decisions if d.drone == drone]
        return [m for step in steps if (m := self.truth(step, drone).distance_m) is not None]


@pytest.fixture(scope="module")
def flown(fly_once):
    """Fly one of them in lockstep, undrawn; each flies once."""
    flights: dict[str, Failed] = {}

    def of(name: str) -> Failed:
        if name not in flights:
            episode = FLEET if name == "one-point" else ALONE
            spec = FlightSpec(
                episode=episode, pilot=f"failing:{name}", simulated=Simulated(speed=None, rendered=False),
                latency=LatencyPolicy.parse("fixed:0.1"), seconds=SECONDS[name], full=True,
            )  # fmt: skip
            folder = fly_once(spec).run / episode
            logs = read(folder)
            flights[name] = Failed(logs, outcome(logs), folder)
        return flights[name]

    return of


def turned_away(bearing_deg: float | None, x: float) -> float:
    """Return how far apart a target's bearing and a commanded point are, 0–1000 across the picture."""
    return abs(500.0 + 500.0 * math.tan(math.radians(bearing_deg or 0.0)) - x)


def test_one_declares_at_once(flown):
    flight = flown("declares-at-once")
    assert flight.kinds[0] == FINISHED
    assert set(flight.kinds[1:]) == {THINK}
    assert min(flight.distances()) > 3.0 * RADIUS_M
    assert (flight.verdict.outcome, flight.verdict.declarations, flight.verdict.false_declarations) == ("failure", 1, 1)


def test_one_declares_at_1_3_of_the_start_distance(flown):
    flight = flown("declares-early")
    first = flight.kinds.index(FINISHED)
    assert 1.25 <= flight.distances()[first] / flight.distances()[0] <= 1.35
    assert flight.kinds.count(FINISHED) == 1
    assert flight.verdict.outcome == "failure"


def test_one_arrives_and_never_declares(flown):
    flight = flown("never-declares")
    assert min(flight.distances()) <= RADIUS_M
    assert flight.distances()[-1] <= RADIUS_M
    assert flight.truth(len(flight.kinds) - 1).visible
    assert flight.verdict.declarations == 0
    assert flight.verdict.diagnostics is not None
    assert flight.verdict.diagnostics.oracle_success
    assert flight.verdict.outcome == "failure"


def test_one_oscillates(flown):
    flight = flown("oscillates")
    told = flight.verdict.diagnostics
    assert told is not None
    assert told.path_m > 5.0 * (flight.distances()[0] - min(flight.distances()))
    assert all(abs(m - flight.distances()[0]) < 4.0 for m in flight.distances())
    strides = [flight.truth(step).position_ned for step, kind in enumerate(flight.kinds) if kind == GO]
    assert len(strides) > 6
    assert all(
        sum((a - b) ** 2 for a, b in zip(here, later, strict=True)) < 1.0
        for here, later in zip(strides[::2], strides[2::2], strict=False)
        if here and later
    )


def test_one_never_points_near_the_target(flown):
    flight = flown("never-grounds")
    seen = 0
    for decision in flight.logs.decisions:
        truth, action = flight.truth(decision.step), decision.action or {}
        if decision.kind == GO and truth.visible:
            seen += 1
            assert turned_away(truth.bearing_deg, action["point"][0]) > 400.0
    assert seen >= 2
    assert min(flight.distances()) > RADIUS_M
    assert flight.verdict.declarations == 0


def test_one_points_at_the_target_and_never_closes(flown):
    flight = flown("never-closes")
    for decision in flight.logs.decisions:
        assert decision.action is not None
        assert turned_away(flight.truth(decision.step).bearing_deg, decision.action["point"][0]) < 40.0
    assert max(abs(m - flight.distances()[0]) for m in flight.distances()) < 1.0
    assert flight.verdict.declarations == 0


def test_one_gives_four_drones_one_point(flown):
    flight = flown("one-point")
    steps: dict[int, list[object]] = {}
    for decision in flight.logs.decisions:
        steps.setdefault(decision.step, []).append(decision.action)
    whole = [actions for actions in steps.values() if len(actions) == 4]
    assert len(whole) > 5
    assert all(actions == [actions[0]] * 4 for actions in whole)
    going = [step for step in steps if flight.logs.decisions[4 * step].kind == GO]
    assert len(going) > 5
    true = [[flight.truth(step, drone).bearing_deg for drone in range(4)] for step in going[:3]]
    assert all(max(b or 0.0 for b in bearings) - min(b or 0.0 for b in bearings) > 5.0 for bearings in true)


def test_one_leaves_the_protocol(flown):
    flight = flown("leaves-the-protocol")
    assert set(flight.kinds) == {None}
    assert all(decision.error for decision in flight.logs.decisions)
    assert len({decision.reply for decision in flight.logs.decisions}) == len(failing.NO_ACTIONS)
    assert flight.verdict.steps == len(flight.kinds) > 6
    for parser in ("strict", "lenient"):
        for text in failing.NO_ACTIONS:
            assert [one.action for drones in (1, 4) for one in reading(text, drones, "xy", parser)] == [None] * 5


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("declares-at-once", "declared"), ("declares-early", "declared"), ("never-declares", "arrived"),
        ("oscillates", "oscillated"), ("never-closes", "never closed"), ("leaves-the-protocol", "never closed"),
    ],
)  # fmt: skip
def test_each_is_in_its_own_failure_mode(flown, name, mode):
    flight = flown(name)
    assert failure_mode(JudgedFlight(flight.folder, {}, flight.logs)) == mode


@pytest.mark.parametrize("name", NAMES)
def test_each_says_what_it_is_and_wants_the_truth(name):
    assert roster.check(f"failing:{name}") == f"failing:{name}"
    assert not roster.looks(f"failing:{name}")
    assert roster.needs_truth(f"failing:{name}")
    assert name in SECONDS
    from dronecats.flight.run.fly import fly

    spec = FlightSpec(
        connected=Connected(url="udpin://127.0.0.1:1", camera="x"), instruction="go", pilot=f"failing:{name}"
    )
    with pytest.raises(UsageError, match=name):
        fly(spec, None, print)


def test_an_unknown_one_is_refused_and_the_nearest_is_suggested():
    near = NAMES[0]
    with pytest.raises(UsageError, match=f"'failing:{near}'"):
        roster.check(f"failing:{near[:-1]}")


def test_a_failing_flight_is_never_a_models(flown):
    flight = flown("declares-at-once")
    told = json.loads((flight.folder.parent / "run.json").read_text(encoding="utf-8"))["flight"]
    assert (told["pilot"], told["model"]) == ("failing:declares-at-once", None)
    assert ROTATE not in flight.kinds
