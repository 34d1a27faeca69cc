"""Flights with two combined features, e.g. a commander with a schema, or a fleet with fenced replies."""

import json
import re
import sqlite3
import subprocess
import time

import jsonschema
import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models import rate_limits
from dronecats.agent.models.ledger import Ledger
from dronecats.agent.models.spec import ModelSpec
from dronecats.cli.main import main
from dronecats.flight.run import accounts
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import Accounts, FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json
from dronecats.pilots import roster
from dronecats.pilots.scripted import scripted_orders
from dronecats.pilots.server import completion, read_request
from tests.agent.models.faulty_wire import AGAIN, Wire, answer, behind, reset, say
from tests.support.command_line import DRONECATS, last_object
from tests.support.first_question import is_first_question, opened_without_pauses
from tests.support.json_lines import rows

COMMANDED, EASY = "blocks-commanding-01", "residential-approaching-01"
LOGS = ("truth.jsonl", "decisions.jsonl", "verdict.json")
LOCKSTEP = Simulated(speed=None)


@pytest.fixture
def serve(monkeypatch):
    monkeypatch.setattr(accounts, "open_model", opened_without_pauses)
    monkeypatch.setattr(rate_limits, "SLOW_INTERVAL_S", 0.0)  # between questions to a server that was busy
    opened = []

    def start(reply, *faults):
        opened.append(Wire(behind(reply, *faults)))
        return opened[-1]

    yield start
    for wire in opened:
        wire.close()


def fly_model(out, wire, *, schema=None, notify=lambda line: None, **changes):
    """Fly the model that a wire serves; return (result, folder)."""
    model = ModelSpec(provider="vllm", name="m", base_url=wire.url, schema=schema)
    spec = FlightSpec(
        **{
            "model": model,
            "simulated": LOCKSTEP,
            "episode": COMMANDED,
            "latency": LatencyPolicy.parse("fixed:0.5"),
            **changes,
        }
    )
    result = fly(spec, out, notify)
    return result, out / result["episode"]


def held(body):
    """Answer every question like a server that enforces the question's schema."""
    prompt, images = read_request(body)
    schema = json.loads(body)["response_format"]["json_schema"]["schema"]
    reply = scripted_orders(prompt, images) if "orders" in schema.get("properties", {}) else '[{"action": "finished"}]'
    jsonschema.validate(json.loads(reply), schema)
    return completion("m", body, prompt, images, reply)


@pytest.mark.parametrize("drones", [1, 2])
def test_a_commander_works_with_a_server_that_enforces_the_schema(tmp_path, serve, drones):
    wire = serve(held, *AGAIN.values())
    result, folder = fly_model(
        tmp_path / "run", wire, schema="array", command="hierarchical", drones=drones, seconds=6.0, full=True
    )  # fmt: skip
    assert (result["reason"], result["error"]) == ("cap", None)
    first, *others = rows(folder / "commander.jsonl")
    assert (first["error"], len(first["orders"])) == (None, drones)
    assert {drone for one in others for drone in one["confirms"]} == set(range(drones))
    decisions = rows(folder / "decisions.jsonl")
    assert {row["drone"] for row in decisions if "confirmed_by" in row} == set(range(drones))


def vision(body):
    """Answer as the built-in pilot's endpoint does."""
    prompt, images = read_request(body)
    return completion("m", body, prompt, images, roster.answer("vision")(prompt, images))


def logs(folder):
    return [(folder / name).read_bytes() for name in LOGS]


def test_a_fleet_flies_with_fenced_replies_and_the_lenient_parser(tmp_path, serve):
    actions = [{"action": "rotate", "angle_deg": 20 * (k + 1)} for k in range(4)]

    def fenced(body):
        prompt, images = read_request(body)
        text = f"Here is what they do:\n```json\n{json.dumps(actions, indent=2)}\n```\nFly safely!"
        return completion("m", body, prompt, images, text)

    result, folder = fly_model(tmp_path / "run", serve(fenced), parser="lenient", seconds=5.0)
    assert (result["reason"], result["error"]) == ("cap", None)
    decisions = rows(folder / "decisions.jsonl")
    assert [row["action"] for row in decisions[:4]] == actions
    assert {tuple(row["mended"]) for row in decisions} == {("prose", "fence")}
    yaws = {row["drone"]: row["yaw_deg"] for row in rows(folder / "truth.jsonl", "pose") if row["t"] > 2.0}
    before = {row["drone"]: row["yaw_deg"] for row in reversed(rows(folder / "truth.jsonl", "pose")) if row["t"] < 0.6}
    turned = [(yaws[k] - before[k]) % 360.0 for k in range(4)]
    assert turned == sorted(turned)


def test_a_flight_whose_server_fails_is_an_error_and_the_same_command_repeats_it(tmp_path, serve, capsys):
    dead = serve(vision)
    (whole,) = dead.script
    dead.script = [whole, whole, whole, reset]  # the first question, and two steps
    spec = tmp_path / "spec.json"
    model = ModelSpec(provider="local", name="m", base_url=dead.url)
    spec.write_text(json.dumps(as_redacted_json(FlightSpec(model=model, episode=EASY, simulated=LOCKSTEP, seed=3))))
    command = ["fly", "--spec", str(spec), "--out", str(tmp_path / "run"), "--json"]
    folder = tmp_path / "run" / EASY
    assert main(command) == 3
    result = last_object(capsys.readouterr().out)
    assert (result["outcome"], result["steps"]) == ("error", 2)
    assert "http://127.0.0.1" in result["error"]
    names = ("episode.json", "flight.tlog", *LOGS)
    assert all((folder / name).stat().st_size for name in names)
    assert (tmp_path / "run" / "run.json").exists()
    assert rows(folder / "truth.jsonl", "end")[0]["reason"] == "error"
    kept = logs(folder)
    dead.script = [whole]  # the server was started again
    assert main(command) == 0
    assert last_object(capsys.readouterr().out)["outcome"] == "success"
    assert logs(tmp_path / "run" / "unfinished" / f"{EASY}-1") == kept
    assert json.loads((tmp_path / "run" / "run.json").read_text())["flight"]["episode"] == EASY
    assert main(command) == 2  # a scored flight is not repeated
    assert EASY in capsys.readouterr().err


def test_stop_unreadable_ends_a_flight_with_unreadable_replies_as_an_error(tmp_path, serve):
    def cut_off(body):
        prompt, images = read_request(body)
        reply = completion("m", body, prompt, images, '{"acti')
        reply["choices"][0]["finish_reason"] = "length"
        return reply

    result, folder = fly_model(tmp_path / "run", serve(cut_off), episode=EASY, seconds=60.0, stop_unreadable=2)
    assert (result["outcome"], result["reason"], result["status"], result["steps"]) == ("error", "error", 3, 2)
    assert "cut off" in result["error"]
    assert len(rows(folder / "decisions.jsonl")) == 2


def test_measured_latency_includes_the_time_of_a_slow_endpoint(tmp_path, serve):
    def slow(body):
        time.sleep(0.7)
        return vision(body)

    busy = say(answer(503, b"busy"))  # announces its close; else the next question may use a closing connection
    result, folder = fly_model(
        tmp_path / "run", serve(slow, busy), episode=EASY, latency=LatencyPolicy.parse("measured"), seconds=9.0
    )
    assert (result["reason"], result["error"]) == ("cap", None)
    decisions = rows(folder / "decisions.jsonl")
    assert len(decisions) >= 2
    for row in decisions:
        assert row["latency_s"] >= 0.7
        assert row["t_decided"] - row["t_frame"] == pytest.approx(row["latency_s"], abs=0.15)  # the clock's ticks


@pytest.mark.slow
def test_two_flights_at_once_share_a_ledger_and_a_cache(tmp_path, serve):
    """Two processes ask the same questions. No reply is lost or booked twice, and both flights are equal."""
    wire = serve(vision)
    model = ModelSpec(provider="local", name="m", base_url=wire.url, input_usd=1.0, output_usd=1.0)
    shared = Accounts(ledger=str(tmp_path / "ledger.sqlite"), cache=str(tmp_path / "cache.sqlite"), cost_limit_usd=9.0)
    spec = FlightSpec(model=model, episode=EASY, simulated=LOCKSTEP, seconds=10.0, seed=3, accounts=shared)
    (tmp_path / "spec.json").write_text(json.dumps(as_redacted_json(spec)))
    command = [*DRONECATS, "fly", "--spec", str(tmp_path / "spec.json"), "--json", "--out"]
    outs = [tmp_path / "one", tmp_path / "other"]
    together = [subprocess.Popen([*command, str(out)], stdout=subprocess.PIPE, text=True) for out in outs]
    results = [last_object(process.communicate(timeout=600)[0]) for process in together]
    assert [(result["outcome"], result["error"]) for result in results] == [("failure", None)] * 2
    assert logs(outs[0] / EASY) == logs(outs[1] / EASY)
    ledger = Ledger(tmp_path / "ledger.sqlite")
    spent = ledger.spent()
    ledger.close()
    bodies = [body for body in wire.bodies if not is_first_question(body.decode())]  # the cache omits it
    replies = len(set(bodies))
    assert spent.questions == wire.served == len(wire.bodies)
    assert results[0]["steps"] <= replies <= len(bodies) <= 2 * replies
    db = sqlite3.connect(tmp_path / "cache.sqlite")
    assert db.execute("SELECT COUNT(*) FROM replies").fetchone() == (replies,)
    db.close()


def test_a_run_of_several_episodes_names_no_episode_and_each_can_be_replayed(tmp_path, serve, capsys):
    wire, other = serve(vision), "residential-approaching-02"
    for episode in (EASY, other):
        result, _ = fly_model(tmp_path / "run", wire, episode=episode, seconds=4.0)
        assert result["error"] is None
    assert json.loads((tmp_path / "run" / "run.json").read_text())["flight"]["episode"] is None
    replay = ["fly", "--sitl", "--json", "--model"]
    assert main([*replay, f"replay:{tmp_path / 'run'}"]) == 2
    assert str(tmp_path / "run") in capsys.readouterr().err
    question_count = wire.served
    assert main([*replay, f"replay:{tmp_path / 'run' / other}", "--out", str(tmp_path / "again")]) == 0
    assert last_object(capsys.readouterr().out)["episode"] == other
    assert logs(tmp_path / "again" / other) == logs(tmp_path / "run" / other)
    assert wire.served == question_count


def test_a_replay_of_a_flight_that_its_budget_ended_ends_at_the_same_step(tmp_path, serve, capsys):
    limited = Accounts(token_limit=1500)
    result, folder = fly_model(tmp_path / "run", serve(vision), episode=EASY, accounts=limited)
    assert result["reason"] == "budget"
    words = ["fly", "--sitl", "--json", "--model", f"replay:{folder}", "--out", str(tmp_path / "again")]
    assert main(words) == 3
    again = last_object(capsys.readouterr().out)
    assert (again["outcome"], again["steps"]) == ("error", result["steps"])
    assert re.search(rf"step {result['steps']}\b.*drone 1\b.*budget", again["error"])
    assert rows(tmp_path / "again" / EASY / "decisions.jsonl") == rows(folder / "decisions.jsonl")
