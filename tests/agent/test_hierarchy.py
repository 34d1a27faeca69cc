"""A commander with one pilot per drone: the decisions of each, the images that they use, and the end of a flight."""

import json
import re
from concurrent.futures import Executor, Future
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from msgspec import UNSET

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.commanding.command_prompt import INTERVAL_S, STALL_STEPS, CommandPrompt
from dronecats.agent.commanding.hierarchy import FleetCommander, Hierarchy
from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.loop import Questions
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.prompt import Prompt
from dronecats.pilots import actions
from foundation.errors import ModelError
from foundation.run_folder.reading import exchanges
from foundation.run_folder.writing import LineLog, PromptLog
from foundation.setpoints import Hold
from foundation.threads import InlineExecutor
from tests.agent.flown_wire import CAMERA, Clock, Views
from tests.support.charged import Charged
from tests.support.json_lines import rows

GO, TURN, DONE = (
    '{"action":"go","point":[500,500],"depth_m":9}',
    '{"action":"rotate","angle_deg":30}',
    '{"action":"finished"}',
)
EVERYBODY = [{"drone": k, "goal": f"goal {k}"} for k in (1, 2, 3)]


class FunctionModel:
    """A model that answers by a function of the request and records the requests."""

    name = "said"

    def __init__(self, answer):
        self.answer, self.asked = answer, []

    def ask(self, request):
        self.asked.append(request)
        reply = self.answer(request)
        if isinstance(reply, Exception):
            raise reply
        return Reply(reply if isinstance(reply, str) else json.dumps(reply), 0.1, 10, 1)

    def check(self):
        pass

    def close(self):
        pass


class Timed(Views):
    """A camera whose frames have their vehicle's time."""

    def __init__(self, vehicles):
        super().__init__(72, 128)
        self.vehicles = vehicles

    def newest(self, drone=0):
        frame = super().newest(drone)
        return type(frame)(frame.frame_id, drone, self.vehicles[drone].time_us, frame.image_rgb)


class Holding(Clock):
    """A vehicle that records whether its last setpoint moves it."""

    def fly(self, setpoint, seconds=None, seen=None):
        self.moves = not isinstance(setpoint, Hold)
        super().fly(setpoint, seconds, seen)


def script(*replies):
    """Return a commander that gives these replies in order, and then empty orders."""
    coming = iter(replies)
    return FunctionModel(lambda request: next(coming, {"orders": []}))


def fly(folder, pilot, commander, *, seconds=30.0, drones=3, policy="fixed:0.5", executor=None, stop=None):
    """Fly a hierarchy; return (decisions, exchanges, vehicles)."""
    folder.mkdir(exist_ok=True)
    vehicles = [Holding() for _ in range(drones)]
    log, prompts = LineLog(folder / "decisions.jsonl"), PromptLog(folder / "prompts.jsonl")
    cockpit = Cockpit(
        aircraft=vehicles, camera=Timed(vehicles), camera_model=CAMERA, log=log, prompts=prompts,
        frames_dir=folder, executor=executor or InlineExecutor(), t0_us=0, commander_log=folder / "commander.jsonl",
    )  # fmt: skip
    charge = LatencyPolicy.parse(policy) if isinstance(policy, str) else policy
    questions = Questions(pilot, Prompt.load(None), "find it", charge)
    agent = Hierarchy(questions, commander, CommandPrompt.load(), cockpit)
    try:
        agent.fly(seconds, stop or (lambda decision: False))
    finally:
        log.close()
        prompts.close()
    return rows(folder / "decisions.jsonl"), exchanges(folder), vehicles


def command_of(request):
    return actions.read_prompt(request.text).command


def test_drones_hover_until_the_first_orders_and_then_fly_their_goals(tmp_path):
    pilot, commander = FunctionModel(lambda request: GO), script({"orders": EVERYBODY[:2]})
    decisions, (first, *_), _ = fly(tmp_path, pilot, commander, policy="fixed:2", seconds=12.0)
    assert first.t_answered == pytest.approx(2.0, abs=0.1)
    assert min(d["t_frame"] for d in decisions) >= first.t_answered
    goals = {request.drone: command_of(request) for request in pilot.asked}
    assert goals == {0: "goal 1", 1: "goal 2", 2: "find it"}  # a drone without a goal uses the episode's instruction
    assert {len(request.images_jpeg) for request in pilot.asked} == {1}
    first_request = commander.asked[0]
    assert (first_request.role, len(first_request.images_jpeg)) == ("commander", 3)
    assert first_request.labels == ("Drone 1:", "Drone 2:", "Drone 3:")
    assert sorted({d["step"] for d in decisions}) == list(range(len(decisions)))


def test_a_pilots_finished_is_a_report_and_the_commanders_confirmation_declares(tmp_path):
    pilot = FunctionModel(lambda request: DONE if request.drone == 1 else GO)
    commander = script({"orders": EVERYBODY}, {"confirm": [2]})
    decisions, exchange_log, vehicles = fly(tmp_path, pilot, commander, seconds=9.0)
    report, confirmed = (d for d in decisions if d["drone"] == 1)
    assert (report["action"], report["report"]) == ({"action": "finished"}, True)
    assert (confirmed["action"], confirmed["confirmed_by"]) == ({"action": "finished"}, 1)
    assert "report" not in confirmed
    assert "reply" not in confirmed
    assert [cause.why for cause in exchange_log[1].causes] == ["report"]
    assert exchange_log[1].confirms == (1,)
    assert confirmed["frame_id"] == exchange_log[1].frames[1] != report["frame_id"]
    assert confirmed["t_frame"] >= report["t_decided"]
    assert sum(request.drone == 1 for request in pilot.asked) == 1  # afterwards it hovers
    assert vehicles[1].moves is False
    assert all(d["report"] is False for d in decisions if d["drone"] != 1)


def test_only_a_confirmation_may_end_the_flight(tmp_path):
    seen = []

    def stop(decision):
        seen.append(decision)
        return decision.declares

    pilot, commander = FunctionModel(lambda request: DONE), script({"orders": EVERYBODY}, {"confirm": [1]})
    decisions, *_ = fly(tmp_path, pilot, commander, stop=stop, seconds=60.0, policy="fixed:4")
    assert [d["drone"] for d in decisions if "confirmed_by" in d] == [0]
    assert decisions[-1]["confirmed_by"] == 1
    assert seen[-1].declares


def test_a_drone_waits_after_its_report_and_a_new_order_clears_its_history(tmp_path):
    def answer(request):
        return DONE if request.drone == 0 and command_of(request) == "goal 1" else GO

    pilot = FunctionModel(answer)
    commander = script({"orders": EVERYBODY}, {"orders": []}, {"orders": [{"drone": 1, "goal": "the next"}]})
    decisions, exchange_log, _ = fly(tmp_path, pilot, commander, seconds=INTERVAL_S + 20.0)
    assert [exchange.causes[0].why for exchange in exchange_log[:3]] == [
        "start",
        "report",
        "time",
    ]  # one question per report
    own = [d for d in decisions if d["drone"] == 0]
    assert own[0]["report"] is True
    assert own[1]["t_frame"] >= exchange_log[2].t_answered > INTERVAL_S
    requests = [request for request in pilot.asked if request.drone == 0]
    assert [command_of(request) for request in requests[:2]] == ["goal 1", "the next"]
    assert actions.read_prompt(requests[1].text).past(0) == ()  # a new goal starts a new context
    assert [past.kind for past in actions.read_prompt(requests[2].text).past(0)] == ["go"]


class Updated(FunctionModel):
    """A commander whose vendor replaces its version during the flight."""

    served_names = (None, "said fp_1", "said fp_1", "said fp_2", None)

    def ask(self, request):
        reply = super().ask(request)
        return replace(reply, served=self.served_names[min(len(self.asked), len(self.served_names)) - 1])


def test_the_commanders_served_model_is_logged_when_it_changes(tmp_path):
    commander = Updated(lambda request: {"orders": EVERYBODY[:1]})
    _, exchange_log, _ = fly(tmp_path, FunctionModel(lambda request: DONE), commander, seconds=60.0)
    served = [None if exchange.served is UNSET else exchange.served for exchange in exchange_log]
    assert served[:6] == [None, "said fp_1", None, "said fp_2", "said", None]


def test_an_unreadable_commander_reply_is_logged_and_has_no_effect(tmp_path):
    pilot = FunctionModel(lambda request: DONE if request.drone == 2 else GO)
    commander = FunctionModel(lambda request: "I would go left, I think.")
    decisions, exchange_log, _ = fly(tmp_path, pilot, commander, seconds=20.0)
    assert {command_of(request) for request in pilot.asked} == {"find it"}
    assert {d["drone"] for d in decisions} == {0, 1, 2}
    assert not [d for d in decisions if "confirmed_by" in d]
    assert all('"orders"' in exchange.error for exchange in exchange_log)
    assert exchange_log[0].reply == "I would go left, I think."
    assert exchange_log[0].orders == exchange_log[0].confirms == ()


def test_a_commander_reply_affects_only_reports_that_it_was_shown(tmp_path):
    """The commander's reply neither confirms nor overrules a report made after its question."""

    def answer(request):  # drone 2 reports while the commander answers the report of drone 1
        turn = {0: 15, 1: 21}.get(request.drone)
        return GO if turn is None else DONE if request.step else {"action": "rotate", "angle_deg": turn}

    reply = {"orders": [{"drone": 2, "goal": "other"}], "confirm": [1, 2, 3]}
    commander = script({"orders": EVERYBODY}, reply, {"confirm": [2]})
    decisions, exchange_log, _ = fly(tmp_path, FunctionModel(answer), commander, seconds=12.0)
    assert [(cause.why, cause.drone) for cause in exchange_log[1].causes] == [("report", 0)]
    assert exchange_log[1].confirms == (0,)
    assert exchange_log[1].orders == ()
    assert re.findall(r"drone (\d)", exchange_log[1].error) == [
        "2",
        "3",
        "2",
    ]  # confirmations of drones 2 and 3, which had no report, and the order for drone 2, which had reported meanwhile
    # the next question, about the report of drone 2, follows at once
    assert [(cause.why, cause.drone) for cause in exchange_log[2].causes] == [("report", 1)]
    assert [(d["drone"], d["confirmed_by"]) for d in decisions if "confirmed_by" in d] == [(0, 1), (1, 2)]


def test_a_report_that_arrives_with_the_commanders_pictures_is_a_cause_of_the_question(tmp_path, monkeypatch):
    newest_frames = FleetCommander._newest_frames

    def late_frames(self, *arguments):
        for _ in range(60):  # ticks; drone 2 reports meanwhile
            yield
        return (yield from newest_frames(self, *arguments))

    monkeypatch.setattr(FleetCommander, "_newest_frames", late_frames)
    pilot = FunctionModel(lambda request: {0: DONE, 1: DONE if request.step else TURN}.get(request.drone, GO))
    _, exchange_log, _ = fly(tmp_path, pilot, script({"orders": EVERYBODY}), seconds=15.0)
    assert [(cause.why, cause.drone) for cause in exchange_log[1].causes] == [("report", 0), ("report", 1)]


def test_the_commander_is_asked_after_a_stall_and_after_an_interval(tmp_path):
    pilot = FunctionModel(lambda request: TURN if request.drone == 1 else GO)
    decisions, exchange_log, _ = fly(tmp_path, pilot, script({"orders": EVERYBODY}), seconds=40.0)
    (start, *others) = [[(cause.why, cause.drone) for cause in exchange.causes] for exchange in exchange_log]
    assert start == [("start", None)]
    assert others
    assert all(("stall", 1) in causes and ("stall", 0) not in causes for causes in others)
    still = [d for d in decisions if d["drone"] == 1 and d["t_decided"] <= exchange_log[1].t_asked]
    assert len(still) == STALL_STEPS
    times_s = [exchange.t_asked for exchange in exchange_log[1:]]
    assert (
        min(after - before for before, after in pairwise(times_s)) > 0.9 * STALL_STEPS
    )  # 1 s for each turn and its question
    pilot = FunctionModel(lambda request: GO)
    _, exchange_log, _ = fly(tmp_path / "calm", pilot, script({"orders": EVERYBODY}), seconds=100.0)
    assert [exchange.causes[0].why for exchange in exchange_log] == ["start", "time", "time"]
    assert exchange_log[2].t_asked - exchange_log[1].t_asked == pytest.approx(INTERVAL_S, abs=0.2)


def test_latency_is_charged_on_both_levels_with_separate_reproducible_draws(tmp_path):
    pilot, commander = FunctionModel(lambda request: GO), script({"orders": EVERYBODY})
    decisions, exchange_log, _ = fly(tmp_path, pilot, commander, policy="lognormal:1,0.5", seconds=60.0)
    first = [next(d for d in decisions if d["drone"] == k)["latency_s"] for k in range(3)]
    assert len({*first, exchange_log[0].latency_s}) == 4  # all four have step number 0
    assert exchange_log[0].t_answered - exchange_log[0].t_asked == pytest.approx(exchange_log[0].latency_s, abs=0.06)
    again, exchange_log_again, _ = fly(
        tmp_path / "again", pilot, script({"orders": EVERYBODY}), policy="lognormal:1,0.5", seconds=60.0
    )
    assert (again, exchange_log_again) == (decisions, exchange_log)


class Slow(Executor):
    """Runs every call at once and reports it as done some polls later. `together`: roles of calls in progress."""

    def __init__(self):
        self.under_way: list[str] = []
        self.together: set[tuple[str, ...]] = set()

    def submit(self, fn, /, *args, **kwargs):
        executor, inner = self, InlineExecutor().submit(fn, *args, **kwargs)
        role = next((value.role for value in args if isinstance(value, Request)), "picture")

        class Polled(Future[Any]):
            polls = 0

            def done(self):
                self.polls += 1
                if self.polls == 5:
                    executor.under_way.remove(role)
                return self.polls >= 5

            def exception(self, timeout=None):
                return inner.exception()

            def result(self, timeout=None):
                return inner.result()

        self.under_way.append(role)
        self.together.add(tuple(sorted(self.under_way)))
        return Polled()


def test_pilots_and_commander_are_asked_concurrently(tmp_path):
    """The commander is asked again while the pilots go on."""
    executor = Slow()
    fly(tmp_path, FunctionModel(lambda request: GO), script({"orders": EVERYBODY}), policy="real", executor=executor,
        seconds=3.0 * INTERVAL_S)  # fmt: skip
    assert ("pilot",) * 3 in executor.together
    assert any({"commander", "pilot"} <= set(roles) for roles in executor.together)


@pytest.mark.parametrize("role", ["pilot", "commander"])
def test_a_failing_pilot_or_commander_model_ends_the_flight(tmp_path, role):
    broken = ModelError("gone")
    pilot = FunctionModel(lambda request: broken if role == "pilot" else DONE)
    commander = script({"orders": EVERYBODY}, broken if role == "commander" else {"orders": []})
    with pytest.raises(ModelError, match="gone"):
        fly(tmp_path, pilot, commander)


def test_a_late_commander_reply_is_logged_as_late_and_a_failed_call_is_an_error(tmp_path):
    pilot = FunctionModel(lambda request: DONE)
    _, exchange_log, _ = fly(tmp_path, pilot, script({"orders": EVERYBODY}), policy="fixed:2", seconds=5.0)
    assert exchange_log[-1].t_answered is None
    assert exchange_log[-1].error
    decisions, (first,), _ = fly(tmp_path / "slow", pilot, script(), policy="fixed:20", seconds=5.0)
    assert (decisions, first.t_answered) == ([], None)
    with pytest.raises(ModelError, match="gone"):
        fly(tmp_path / "broken", pilot, script(ModelError("gone")), policy="fixed:20", seconds=5.0)


def test_a_question_open_at_the_cap_is_no_error_if_other_drones_had_replies(tmp_path):
    """The only question of the third drone is open at the cap. The step numbers have no gap."""
    pilot = FunctionModel(lambda request: GO)
    policy = Charged((), lambda question: 100.0 if question.drone == 2 else 0.5)
    decisions, *_ = fly(tmp_path, pilot, script({"orders": EVERYBODY}), policy=policy, seconds=8.0)
    assert {d["drone"] for d in decisions} == {0, 1}
    assert {request.drone for request in pilot.asked} == {0, 1, 2}
    assert sorted(d["step"] for d in decisions) == list(range(len(decisions)))
