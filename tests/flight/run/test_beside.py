"""With a known latency, the vehicle flies its hold while the model answers. The logs do not depend on this."""

import threading
from dataclasses import replace

import pytest

from dronecats.agent import loop as decider
from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.loop import PendingQuestion
from dronecats.agent.models.spec import ModelSpec
from dronecats.flight.run import pilot as run_pilot
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.stages.lockstep import Lockstep
from dronecats.pilots.server import PilotServer
from tests.support.first_question import after_first_question

LOGS = ("truth.jsonl", "decisions.jsonl", "verdict.json")
PATIENCE_S = 30.0  # s; a failing test waits this long


class Model:
    """Answers only after vehicle time has passed since the question, if `waits`."""

    def __init__(self, monkeypatch, waits):
        self.held = []  # for each question: whether the vehicle flew meanwhile
        self._waits, self._ticks, self._asked_at = waits, 0, 0
        self._changed = threading.Condition()
        pump = Lockstep.pump
        model = self

        def pumped(clock):
            pump(clock)
            with model._changed:
                model._ticks += 1
                model._changed.notify()

        class Noted(PendingQuestion):
            def __init__(self, *arguments):
                model._asked_at = model._ticks
                super().__init__(*arguments)

        monkeypatch.setattr(Lockstep, "pump", pumped)
        monkeypatch.setattr(decider, "PendingQuestion", Noted)

    def __call__(self, prompt, images):
        with self._changed:
            flown_on = self._waits and self._changed.wait_for(lambda: self._ticks > self._asked_at, PATIENCE_S)
            self.held.append(flown_on)
        return '{"action": "rotate", "angle_deg": 30}'


def logged_bytes(folder, model, latency):
    """Fly a short flight with a model and return the bytes of its logs."""
    server = PilotServer(after_first_question(model), "stub").start()
    try:
        spec = FlightSpec(
            model=ModelSpec(provider="local", name="stub", base_url=server.base_url),
            episode="blocks-commanding-01",
            drones=1,
            simulated=Simulated(speed=None),
            latency=LatencyPolicy.parse(latency),
            seconds=4.0,
            full=True,
        )
        result = fly(spec, folder, lambda line: None)
    finally:
        server.close()
    assert result["reason"] == "cap", result["error"]
    episode_folder = next(folder.rglob("truth.jsonl")).parent
    return {name: (episode_folder / name).read_bytes() for name in LOGS}


@pytest.mark.parametrize("latency", ["fixed:0.7", "lognormal:0.8,0.3"])
def test_the_vehicle_flies_while_the_model_answers_and_the_logs_are_the_same(tmp_path, monkeypatch, latency):
    meanwhile = Model(monkeypatch, waits=True)
    beside = logged_bytes(tmp_path / "beside", meanwhile, latency)
    assert len(meanwhile.held) >= 2
    assert all(meanwhile.held)

    questions = run_pilot.questions_of
    monkeypatch.undo()
    monkeypatch.setattr(run_pilot, "questions_of", lambda *of: replace(questions(*of), beside=False))
    assert logged_bytes(tmp_path / "in turn", Model(monkeypatch, waits=False), latency) == beside
