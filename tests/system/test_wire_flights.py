"""Complete lockstep flights: over a connection that fails in every step, from a cache, and from a recording."""

import json
import re
from dataclasses import replace

import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models import rate_limits
from dronecats.agent.models.ledger import Ledger
from dronecats.agent.models.spec import ModelSpec
from dronecats.cli.main import main
from dronecats.flight.run import accounts
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import Accounts, FlightSpec, Simulated
from dronecats.pilots import roster
from dronecats.pilots.server import completion, read_request
from foundation.run_folder.layout import LEDGER
from tests.agent.models.faulty_wire import AGAIN, Wire, behind
from tests.support.command_line import last_object
from tests.support.first_question import opened_without_pauses
from tests.support.json_lines import rows

LOGS = ("truth.jsonl", "decisions.jsonl", "verdict.json")
EASY = "residential-approaching-01"
LOCKSTEP = FlightSpec(
    episode=EASY, simulated=Simulated(speed=None), pilot="vision", seed=3, latency=LatencyPolicy.parse("fixed:0.5")
)


def logs(folder):
    return [(folder / name).read_bytes() for name in LOGS]


def vision(body):
    """Answer a request as the built-in pilot's endpoint does."""
    prompt, images = read_request(body)
    return completion("vision", body, prompt, images, roster.answer("vision")(prompt, images))


@pytest.fixture
def serve():
    opened = []

    def start(*faults, reply=vision):
        opened.append(Wire(behind(reply, *faults)))
        return opened[-1]

    yield start
    for wire in opened:
        wire.close()


def asking(wire, **changes):
    model = ModelSpec(provider="local", name="vision", base_url=wire.url, input_usd=1.0, output_usd=10.0)
    return replace(LOCKSTEP, pilot=None, model=model, **changes)


def fly_spec(spec, out):
    result = fly(spec, out, lambda line: None)
    return result, out / result["episode"]


def replayed(capsys, folder, out, *words):
    assert main(["fly", "--sitl", "--model", f"replay:{folder}", "--out", str(out), "--json", *words]) == 0
    output = capsys.readouterr().out
    assert folder.name in output.splitlines()[0]
    return last_object(output), out / folder.name


def test_a_connection_that_fails_twice_per_step_does_not_change_the_flight(serve, tmp_path, monkeypatch):
    monkeypatch.setattr(accounts, "open_model", opened_without_pauses)
    monkeypatch.setattr(rate_limits, "SLOW_INTERVAL_S", 0.0)  # pause between questions to a busy server
    result, whole = fly_spec(asking(serve()), tmp_path / "whole")
    broken = serve(*AGAIN.values())
    hurt, folder = fly_spec(asking(broken), tmp_path / "broken")
    assert result["outcome"] == hurt["outcome"] == "success"
    assert logs(folder) == logs(whole)
    assert broken.served == 3 * (1 + result["steps"]) >= 15  # the first question before take-off is one more


def test_cache_and_recording_repeat_a_flight_without_model_calls(serve, tmp_path, capsys):
    wire = serve()
    spec = asking(
        wire,
        latency=LatencyPolicy.parse("measured"),
        seconds=12.0,
        accounts=Accounts(cache=str(tmp_path / "replies.sqlite")),
    )
    result, first = fly_spec(spec, tmp_path / "first")
    assert result["reason"] == "cap"
    question_count = wire.served
    # one question comes before take-off, and a reply that is pending at the cap is not logged
    assert question_count - result["steps"] in (1, 2)
    assert len({row["latency_s"] for row in rows(first / "decisions.jsonl")}) > 1
    wire.close()
    _, again = fly_spec(spec, tmp_path / "again")
    assert wire.served == question_count
    assert logs(again) == logs(first)
    assert not list((tmp_path / "again").glob("*.sqlite-wal"))
    _, third = replayed(capsys, first, tmp_path / "third")
    assert logs(third) == logs(first)


def test_router_details_are_recorded_and_replayed(serve, tmp_path, capsys):
    def routed(body):
        reply = vision(body)
        reply["usage"]["prompt_tokens_details"] = {"cached_tokens": 5}
        return {**reply, "provider": "DeepInfra"}

    _, first = fly_spec(asking(serve(reply=routed), seconds=4.0), tmp_path / "first")
    decisions = rows(first / "decisions.jsonl")
    assert {(row["tokens_cached"], row["endpoint"], row.get("tokens_reasoning")) for row in decisions} == {
        (5, "DeepInfra", None)
    }
    _, again = replayed(capsys, first, tmp_path / "again")
    assert logs(again) == logs(first)


def test_a_replay_has_the_recorded_latencies(tmp_path, capsys):
    _, first = fly_spec(
        replace(LOCKSTEP, latency=LatencyPolicy.parse("lognormal:1,0.5"), seconds=12.0, full=True), tmp_path / "first"
    )
    result, again = replayed(capsys, first, tmp_path / "again")
    assert logs(again) == logs(first)
    assert result["pilot"] == "replay of vision"
    # the run file of a replay is enough to repeat it, even if the recording has moved
    first.rename(tmp_path / "elsewhere")
    assert main(["fly", "--spec", str(again.parent / "run.json"), "--out", str(tmp_path / "third")]) == 0
    assert logs(tmp_path / "third" / EASY) == logs(again)


def test_a_replay_of_four_drones_equals_the_recording(tmp_path, capsys):
    spec = replace(LOCKSTEP, episode="residential-commanding-02", seconds=4.0)
    _, first = fly_spec(spec, tmp_path / "first")
    assert {row["drone"] for row in rows(first / "decisions.jsonl")} == {0, 1, 2, 3}
    _, again = replayed(capsys, tmp_path / "first" / first.name, tmp_path / "again")
    assert logs(again) == logs(first)


@pytest.mark.slow("a fleet flies for a minute, twice")
def test_a_replay_of_a_hierarchical_fleet_equals_the_recording(tmp_path, capsys):
    unseen = Simulated(speed=None, rendered=False)
    spec = replace(LOCKSTEP, episode="residential-commanding-02", pilot="oracle", command="hierarchical", full=True)
    spec = replace(spec, simulated=unseen, seconds=60.0, latency=LatencyPolicy.parse("lognormal:1,0.5"))
    _, first = fly_spec(spec, tmp_path / "first")
    commanded = rows(first / "commander.jsonl")
    assert any(row["confirms"] for row in commanded)
    _, again = replayed(capsys, tmp_path / "first" / first.name, tmp_path / "again")
    assert logs(again) == logs(first)
    assert (again / "commander.jsonl").read_bytes() == (first / "commander.jsonl").read_bytes()


def test_a_replay_beyond_its_recording_is_an_unscored_error(tmp_path, capsys):
    _, first = fly_spec(LOCKSTEP, tmp_path / "first")  # it ends with a declaration; a cap needs one more reply
    log = first / "decisions.jsonl"
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:2]))
    words = ["--latency", "fixed:0.4", "--full", "--out", str(tmp_path / "other"), "--json"]
    assert main(["fly", "--sitl", "--model", f"replay:{first}", *words]) == 3
    captured = capsys.readouterr()
    assert "--latency, --full" in captured.out.splitlines()[0]
    result = last_object(captured.out)
    assert result["outcome"] == "error"
    assert re.search(r"step 2\b.*drone 1\b", result["error"])


def test_a_flight_with_a_spent_budget_lands_and_is_not_scored(serve, tmp_path, capsys):
    notices: list[str] = []
    spec = asking(serve(), accounts=Accounts(token_limit=3500))
    result = fly(spec, tmp_path / "run", notices.append)
    assert (result["outcome"], result["reason"], result["status"]) == ("error", "budget", 3)
    assert re.search("3,500 tokens.*--token-limit", result["error"])
    folder = tmp_path / "run" / EASY
    decisions, end = rows(folder / "decisions.jsonl"), rows(folder / "truth.jsonl", "end")[0]
    ledger = Ledger(tmp_path / "run" / LEDGER)
    total = ledger.spent()
    ledger.close()
    of_steps = [row["tokens_in"] + row["tokens_out"] for row in decisions]
    first = total.tokens - sum(of_steps)  # the question before take-off also uses tokens
    assert 0 < first < of_steps[0]
    assert total.questions == 1 + len(decisions)
    assert total.tokens - of_steps[-1] < 3500 <= total.tokens
    assert end["reason"] == "budget"
    assert any("landing" in line for line in notices)
    usd = (total.tokens_in * 1.0 + total.tokens_out * 10.0) / 1e6
    assert any(line.endswith(f" {total.tokens:,} tokens, ${usd:.4f}") for line in notices)
    # without a remaining budget, a flight starts no simulation
    again = fly(replace(spec, episode="residential-approaching-02"), tmp_path / "run", notices.append)
    assert (again["reason"], again["steps"], again["sim_seconds"]) == ("budget", 0, 0.0)
    assert json.loads((tmp_path / "run" / "run.json").read_text())["flight"]["accounts"]["token_limit"] == 3500
