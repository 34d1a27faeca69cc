"""An external harness sends the replies. The flight equals that of a pilot with the same replies, byte for byte."""

import json

import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.bench.harnesses.outside_flight import OutsideFlight
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import ExternalHarness, FlightSpec, Simulated
from foundation.errors import UsageError

EPISODE = "blocks-commanding-01"
WORDS = [
    '{"action": "go", "point": [430, 520], "depth_m": 9}',
    '{"action": "rotate", "angle_deg": 30}',
    '{"action": "finished"}',
]


def spec(**more):
    return FlightSpec(
        **{
            "episode": EPISODE,
            "drones": 1,
            "simulated": Simulated(speed=None),
            "outside": ExternalHarness(harness="a test", name="three words"),
            "latency": LatencyPolicy.parse("fixed:0.5"),
            "seconds": 9.0,
            **more,
        }
    )


def answer_all(flight):
    questions: list[object] = []
    while (question := flight.question()) is not None:
        flight.answer(WORDS[min(len(questions), 2)], tokens_in=7, tokens_out=3)
        questions.append(question)
    return questions


def test_an_outside_flight_equals_the_flight_of_a_pilot_with_the_same_replies(tmp_path):
    flight = OutsideFlight(spec(), tmp_path / "outside")
    questions = answer_all(flight)
    result = flight.result()
    assert result.outcome == "failure"
    assert result.steps == len(questions) >= 3
    assert result.pilot == "a test:three words"
    script = tmp_path / "script.jsonl"
    script.write_text("".join(json.dumps({"step": k, "reply": word}) + "\n" for k, word in enumerate(WORDS)))
    with script.open("a") as more:
        more.writelines(json.dumps({"step": k, "reply": WORDS[2]}) + "\n" for k in range(3, 40))
    fly(spec(outside=None, pilot=f"recorded:{script}"), tmp_path / "served", lambda line: None)
    other = tmp_path / "served" / EPISODE
    for log in ("truth.jsonl", "verdict.json"):
        assert (flight.folder / log).read_bytes() == (other / log).read_bytes()
    ours, theirs = ([json.loads(line) for line in (f / "decisions.jsonl").open()] for f in (flight.folder, other))
    tokens = ("tokens_in", "tokens_out")
    assert [{**row, **dict.fromkeys(tokens)} for row in ours] == [{**row, **dict.fromkeys(tokens)} for row in theirs]
    assert {(row["tokens_in"], row["tokens_out"]) for row in ours} == {(7, 3)}


def test_a_flight_closed_without_a_reply_is_an_error_and_not_a_failure(tmp_path):
    flight = OutsideFlight(spec(), tmp_path)
    assert flight.question() is not None
    with pytest.raises(RuntimeError):
        flight.question()
    flight.close()
    assert flight.question() is None
    result = flight.result()
    assert (result.outcome, result.reason) == ("error", "interrupted")
    with pytest.raises(RuntimeError):
        flight.answer(WORDS[2])


def test_a_missing_reply_is_an_infrastructure_error(tmp_path):
    flight = OutsideFlight(spec(), tmp_path)
    assert flight.question() is not None
    flight.fail("the vendor is away")
    assert flight.question() is None
    result = flight.result()
    assert result.outcome == "error"
    assert "the vendor is away" in str(result.error)


def test_an_outside_flight_cannot_be_flown_without_its_harness():
    with pytest.raises(UsageError, match=r"three words.*--model replay:RUN"):
        look_up(spec())
    with pytest.raises(UsageError, match="pilot, model or outside"):
        spec(pilot="vision")
