"""Each model gets one small question before take-off. A wrong key or address is reported on the ground."""

import json
from dataclasses import replace

import pytest

from dronecats.agent.models.ledger import Ledger
from dronecats.agent.models.model import Reply
from dronecats.agent.models.replay import FlightRecording, ReplyCache
from dronecats.agent.models.spec import ModelSpec
from dronecats.bench.benchmark_folder import Bench
from dronecats.bench.matrix import BenchEntry, choose_suite
from dronecats.flight.run.accounts import FirstQuestions
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import Accounts, FlightSpec, Simulated
from foundation.errors import ModelError, UsageError
from foundation.run_folder.layout import LEDGER
from tests.agent.models.faulty_wire import Wire, hang
from tests.agent.models.pointing import wrapped
from tests.agent.models.recording import Recording
from tests.support.refusal import refusal

EASY = "residential-approaching-01"
THINK = json.dumps(wrapped("openai", '{"action": "think"}', 100, 20)).encode()


def silent(line):
    pass


def ask_first(spec):
    questions = FirstQuestions([spec], None, silent)
    questions.ask()


def flight(url, name="m", **changes):
    model = ModelSpec(provider="local", name=name, base_url=url, input_usd=1.0, output_usd=10.0)
    return FlightSpec(**{"model": model, "simulated": Simulated(speed=None), "episode": EASY, **changes})


def test_a_wrong_key_ends_a_flight_before_anything_starts(tmp_path):
    with Recording(b'{"error": {"message": "Incorrect API key provided"}}', 401) as server:
        message = refusal(fly, flight(f"{server.url}/v1"), tmp_path / "run", silent)
    assert len(server.sent) == 1
    assert all(word in message for word in ("401", "/v1/chat/completions", "Incorrect API key"))
    assert not (tmp_path / "run").exists()


def test_the_error_for_an_address_without_v1_suggests_v1():
    with Recording(b'{"detail": "Not Found"}', 404) as server:
        message = refusal(ask_first, flight(server.url))
        assert f"{server.url}/v1" in message
        assert f"{server.url}/chat/completions" in message
        assert "--base-url" not in refusal(ask_first, flight(f"{server.url}/v1"))


def test_a_model_that_does_not_answer_is_reported_before_takeoff():
    wire = Wire(hang)
    message = refusal(ask_first, flight(wire.url, patience_s=1.0), error=ModelError)
    wire.close()
    assert " 1 s" in message


def test_the_first_question_is_in_the_ledger_and_counts_towards_the_limit(tmp_path):
    with Recording(THINK) as server:
        limited = flight(f"{server.url}/v1", accounts=Accounts(token_limit=100))
        result = fly(limited, tmp_path / "run", silent)
        assert (result["reason"], result["steps"]) == ("budget", 0)
        assert len(server.sent) == 1
        fly(replace(limited, episode="residential-approaching-02"), tmp_path / "run", silent)
        assert len(server.sent) == 1  # a run whose budget is spent asks nothing
    ledger = Ledger(tmp_path / "run" / LEDGER)
    spent = ledger.spent()
    ledger.close()
    assert (spent.questions, spent.tokens) == (1, 120)
    assert spent.usd == pytest.approx(0.0003)


def test_each_model_of_a_hierarchy_gets_one_first_question():
    with Recording(THINK) as server:
        one = flight(f"{server.url}/v1", command="hierarchical")
        ask_first(one)
        assert len(server.sent) == 1
        ask_first(replace(one, commander=flight(f"{server.url}/v1", "chief").model))
        assert [sent.body["model"] for sent in server.sent] == ["m", "m", "chief"]


def test_a_replay_or_a_filled_cache_sends_no_first_question(tmp_path):
    recorded = FlightRecording(flight="f", steps=(), to_the_cap=True)
    path = tmp_path / "replies.sqlite"
    with Recording(THINK) as server:
        ask_first(flight(f"{server.url}/v1", replay=recorded))
        ReplyCache(path).keep("q", "m", Reply("x", 1.0))
        ask_first(flight(f"{server.url}/v1", accounts=Accounts(cache=str(path))))
        assert server.sent == []
        ask_first(flight(f"{server.url}/v1", accounts=Accounts(cache=str(tmp_path / "empty.sqlite"))))
        assert len(server.sent) == 1


def open_bench(out, *flights):
    entries = [
        BenchEntry(name=f"{each.model.name}-{each.seed}", flight=replace(each, episode=None), episodes=(EASY,))
        for each in flights
    ]
    return Bench(out, choose_suite([EASY], ()), entries, retry=False)


def test_a_bench_asks_each_model_once_and_adds_it_to_the_ledger(tmp_path):
    with Recording(THINK) as server:
        accounts = Accounts(ledger=str(tmp_path / "bench" / LEDGER))
        one, other = (flight(f"{server.url}/v1", name, accounts=accounts) for name in ("a", "b"))
        open_bench(tmp_path / "bench", one, replace(one, seed=1, model=other.model), other).close()
        assert sorted(sent.body["model"] for sent in server.sent) == ["a", "b"]
    ledger = Ledger(tmp_path / "bench" / LEDGER)
    assert ledger.spent().questions == 2
    ledger.close()


def test_a_bench_with_a_wrong_key_creates_no_folder(tmp_path):
    with Recording(b"{}", 403) as server:
        with pytest.raises(UsageError, match="403"):
            open_bench(tmp_path / "bench", flight(f"{server.url}/v1"))
        assert len(server.sent) == 1
    assert not (tmp_path / "bench").exists()
