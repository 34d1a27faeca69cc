"""A custom agent is one class. It gets a cockpit and is judged like any other agent."""

import json
from dataclasses import replace

import pytest

from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from foundation.errors import UsageError
from foundation.run_folder.rows import Decision
from foundation.setpoints import Hold

EPISODE = "residential-approaching-01"
IMPATIENT = "tests.flight.run.test_another_agent:impatient"
ASKED: list[tuple[str, str]] = []  # (instruction, model) of every flight


class Impatient:
    """Hovers for some seconds, declares arrival at its own position, then gives up."""

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


def impatient(flight, model):
    ASKED.append((flight.instruction, model.name))
    return Impatient


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("nobody", "--agent.*'nobody'.*MODULE:NAME"),
        ("json:nothing", "--agent json:nothing"),
        ("json:__name__", "--agent.*'json:__name__'.*MODULE:NAME"),
    ],
)
def test_an_unknown_agent_is_rejected_before_a_folder_is_created(tmp_path, name, why):
    spec = FlightSpec(pilot="oracle", episode=EPISODE, simulated=Simulated(speed=None), agent=name)
    with pytest.raises(UsageError, match=why):
        fly(spec, tmp_path / "run", lambda line: None)
    assert not (tmp_path / "run").exists()


def test_a_custom_agent_flies_and_is_judged(tmp_path):
    ASKED.clear()
    spec = FlightSpec(pilot="oracle", episode=EPISODE, simulated=Simulated(speed=None), seconds=20.0, agent=IMPATIENT)
    result = fly(spec, tmp_path / "run", lambda line: None)
    assert len(ASKED) == 1
    assert ASKED[0][1] == "oracle"
    assert (result["status"], result["outcome"], result["steps"]) == (0, "failure", 1)
    assert (result["declarations"], result["false_declarations"]) == (1, 1)
    run_record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert (run_record["agent"], run_record["flight"]["agent"]) == (IMPATIENT, IMPATIENT)
    with pytest.raises(UsageError, match="--out"):  # flights of two agents never share a run
        fly(replace(spec, episode="residential-approaching-02", agent="paper"), tmp_path / "run", lambda line: None)
    (begin, *_, end) = (json.loads(line) for line in (tmp_path / "run" / EPISODE / "truth.jsonl").open())
    assert (begin["cap_s"], end["reason"]) == (20.0, "cap")
