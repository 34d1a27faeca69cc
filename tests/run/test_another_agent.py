"""Another agent in the same harness is one class: it gets a cockpit, and is judged like every other."""

import json
from dataclasses import replace

import pytest

from dronecats.agent.decisions import Decision
from dronecats.flight.spec import FlightSpec, Simulated
from dronecats.run.fly import fly
from foundation.errors import UsageError
from foundation.setpoints import Hold

EPISODE = "residential-approaching-01"


class Impatient:
    """Hovers for some seconds, declares arrival where it stands, and has had enough."""

    def __init__(self, cockpit):
        self._cockpit = cockpit
        self.steps = 0

    @property
    def now_s(self):
        return (self._cockpit.aircraft[0].time_us - self._cockpit.t0_us) / 1e6

    def fly(self, cap_s=300.0, stop=lambda decision: False):
        (aircraft,), frame = self._cockpit.aircraft, self._cockpit.camera.newest(0)
        aircraft.fly(Hold())
        while self.now_s < min(cap_s, 4.0):
            aircraft.tick()
            self._cockpit.on_tick()
        taken_s = (frame.time_us - self._cockpit.t0_us) / 1e6
        claim = {"action": "finished"}
        decision = Decision(
            step=0, drone=0, frame_id=frame.frame_id, t_frame=taken_s, t_decided=self.now_s, reply=json.dumps(claim),
            action=claim, error=None, latency_s=0.0, tokens_in=None, tokens_out=None, thinking=False, rate_hz=None,
        )  # fmt: skip
        self._cockpit.log.write(decision)
        self._cockpit.on_step(decision)
        self.steps = 1
        while self.now_s < cap_s:
            aircraft.tick()


def test_another_agent_flies_and_is_judged(tmp_path):
    asked = []

    def make(flight, model):
        asked.append((flight.instruction, model.name))
        return Impatient

    spec = FlightSpec(pilot="oracle", episode=EPISODE, simulated=Simulated(speed=None), seconds=20.0)
    result = fly(spec, tmp_path / "run", lambda line: None, make)
    assert len(asked) == 1
    assert asked[0][1] == "oracle"
    assert (result["status"], result["outcome"], result["steps"]) == (0, "failure", 1)
    assert (result["declarations"], result["false_declarations"]) == (1, 1)
    told = json.loads((tmp_path / "run" / "run.json").read_text())
    assert told["agent"].endswith("test_another_agent_flies_and_is_judged.<locals>.make")
    with pytest.raises(UsageError, match="another pilot or other settings"):  # two agents' flights are no one run
        fly(replace(spec, episode="residential-approaching-02"), tmp_path / "run", lambda line: None)
    (begin, *_, end) = (json.loads(line) for line in (tmp_path / "run" / EPISODE / "truth.jsonl").open())
    assert (begin["cap_s"], end["reason"]) == (20.0, "cap")
