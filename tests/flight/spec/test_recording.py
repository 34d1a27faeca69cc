"""Flight specs from recorded runs, and the command-line options for replays. Nothing flies here."""

import json
import re
from dataclasses import replace

import pytest

from dronecats.agent.latency import LONGEST_S, LatencyPolicy
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.models.replay import ReplayModel
from dronecats.cli.fly_spec import replay_line, spec_of
from dronecats.cli.main import parse
from dronecats.flight.spec.flight_spec import Accounts, Connected, FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json, recorded
from episodes.records import catalogue
from foundation.errors import ModelError, UsageError
from hil.link.envelope import Limits
from tests.support.refusal import refusal

EASY = "residential-approaching-01"
FLOWN = FlightSpec(
    episode=EASY,
    simulated=Simulated(speed=None),
    pilot="vision",
    seed=3,
    latency=LatencyPolicy.parse("lognormal:1,0.5"),
)
ROW = {"frame_id": 1, "t_frame": 0.0, "t_decided": 1.0, "action": None, "error": "none"}
SAID = [
    {"step": 0, "drone": 0, "reply": "a", "latency_s": 0.25, "tokens_in": 7, "tokens_out": 2, **ROW},
    {"step": 0, "drone": 1, "reply": "a", "latency_s": 0.25, "tokens_in": 7, "tokens_out": 2, **ROW},
    {"step": 1, "drone": 0, "reply": "b", "latency_s": 0.5, "finish": "length", **ROW},
]


def folder(path, spec=FLOWN, decisions=SAID, reason="cap", name=EASY):
    """Create the folder of a run and return it."""
    episode = path / name
    episode.mkdir(parents=True)
    (path / "run.json").write_text(json.dumps({"schema": 1, "versions": {}, "flight": as_redacted_json(spec)}))
    (episode / "episode.json").write_text(catalogue.load(EASY).to_json())
    (episode / "decisions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in decisions))
    (episode / "truth.jsonl").write_text(json.dumps({"kind": "end", "t": 9.0, "reason": reason}) + "\n")
    return path


def spec(*words):
    return spec_of(parse(["fly", *words]))


def test_a_replay_repeats_the_recorded_spec_and_the_reply_to_each_question(tmp_path):
    flight = spec("--sitl", "--model", f"replay:{folder(tmp_path)}")
    recording = flight.replay
    assert recording is not None
    assert flight == replace(FLOWN, episode=None, record=flight.record, replay=recording)
    assert flight.record == json.loads(catalogue.load(EASY).to_json())
    assert flight.pilot_name == "replay of vision"
    assert [(each.step, each.drone, each.reply) for each in recording.steps] == [(0, 0, "a"), (1, 0, "b")]
    first, second = recording.steps
    assert (first.latency_s, first.tokens_in, first.tokens_out, first.finish) == (0.25, 7, 2, None)
    assert (second.latency_s, second.tokens_in, second.finish) == (0.5, None, "length")
    assert recording.to_the_cap
    assert not (recorded(folder(tmp_path / "b", reason="decided")).replay or recording).to_the_cap


def test_a_question_open_at_the_end_of_a_flight_gets_an_empty_late_reply(tmp_path):
    declared = {"step": 2, "drone": 0, "reply": "c", **ROW, "action": {"action": "finished"}}
    recording = recorded(folder(tmp_path, decisions=[*SAID, declared], reason="decided")).replay
    assert recording is not None
    model = ReplayModel(recording)
    assert model.ask(Request("", (), False, step=1, drone=0)).text == "b"
    assert model.ask(Request("", (), False, step=1, drone=1)) == Reply("", LONGEST_S)
    for step, drone in ((2, 1), (3, 0)):  # a second question of that drone, and one after the declaration
        with pytest.raises(ModelError):
            model.ask(Request("", (), False, step=step, drone=drone))


def test_explicit_options_override_the_recorded_ones(tmp_path):
    words = ["--sitl", "--model", f"replay:{folder(tmp_path)}", "--seed", "5", "--latency", "fixed:1", "--speed", "2"]
    words += ["--airframe", "nano", "--episode", "residential-searching-01", "--no-envelope", "--full"]
    flight = spec(*words)
    assert (flight.seed, str(flight.latency), flight.full, flight.envelope) == (5, "fixed:1", True, None)
    assert flight.simulated == Simulated(speed=2.0, airframe="nano")
    assert (flight.episode, flight.record) == ("residential-searching-01", None)
    command = replay_line(parse(["fly", *words]), EASY)
    changed = {"--episode", "--seed", "--latency", "--speed", "--airframe", "--no-envelope", "--full"}
    assert set(re.findall(r"--[a-z-]+", command)) == changed
    assert spec(*words, "--parser", "lenient").parser == "lenient"


def test_replies_of_a_real_time_flight_are_charged_their_recorded_latency(tmp_path):
    flown = replace(FLOWN, simulated=Simulated(speed=1.0), latency=LatencyPolicy.parse("real"))
    assert str(recorded(folder(tmp_path, flown)).latency) == "measured"


def test_a_flight_of_px4_is_replayed_with_our_autopilot(tmp_path):
    vehicle = Simulated(speed=1.0, autopilot="px4", px4="run-px4")
    run = folder(tmp_path, replace(FLOWN, simulated=vehicle, keep_ulog=True))
    flight = spec("--sitl", "--model", f"replay:{run}", "--autopilot", "ours")
    assert flight.simulated == Simulated(speed=1.0)
    assert not flight.keep_ulog


@pytest.mark.parametrize(
    "words",
    [("--axis", "yx"), ("--schema", "none"), ("--temperature", "1"), ("--command", "solo"), ("--drones", "1"),
     ("--command", "hierarchical", "--commander", "scripted:divide")],
)  # fmt: skip
def test_options_that_a_replay_cannot_change_are_rejected(tmp_path, words):
    with pytest.raises(UsageError, match=words[0]):
        spec("--sitl", "--model", f"replay:{folder(tmp_path)}", *words)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda run: (run / "run.json").unlink(), "run.json"),
        (lambda run: (run / "run.json").write_text('{"schema": 1, "versions": {}}'), "run.json"),
        (lambda run: folder(run, name="other"), "2 episodes"),
        (lambda run: (run / EASY / "episode.json").unlink(), "episode.json"),
        (lambda run: (run / EASY / "decisions.jsonl").write_text(""), "decision"),
        (lambda run: (run / EASY / "decisions.jsonl").write_text(json.dumps({**ROW, "step": 0, "drone": 0}) + "\n"),
         "decisions.jsonl"),
    ],
    ids=["no run", "no flight", "two", "no record", "no decision", "no reply"],
)  # fmt: skip
def test_unreplayable_runs_are_reported_in_one_sentence(tmp_path, change, word):
    run = folder(tmp_path)
    change(run)
    assert word in refusal(recorded, run)


def test_a_flight_on_a_connected_vehicle_cannot_be_replayed(tmp_path):
    vehicle = Connected(url="udpin://x:1", camera="c")
    flight_spec = FlightSpec(connected=vehicle, instruction="go", pilot="vision", envelope=Limits())
    with pytest.raises(UsageError, match="--pilot recorded:FILE"):
        recorded(folder(tmp_path, flight_spec))
    connect = ["--connect", "udpin://0.0.0.0:1", "--camera", "http://h", "--instruction", "go"]
    with pytest.raises(UsageError, match="--sitl"):
        spec(*connect, "--model", f"replay:{tmp_path}")
    with pytest.raises(UsageError, match="--base-url"):
        spec("--sitl", "--model", f"replay:{tmp_path}", "--base-url", "http://h/v1")


def test_accounts_come_from_options_that_also_override_a_spec_file(tmp_path):
    words = ["--cost-limit", "0.5", "--token-limit", "900", "--cache", "c.sqlite", "--ledger", "l.sqlite"]
    flight = spec("--sitl", "--model", "local/m", "--base-url", "http://h/v1", *words)
    assert flight.accounts == Accounts(cost_limit_usd=0.5, token_limit=900, ledger="l.sqlite", cache="c.sqlite")
    file = tmp_path / "run.json"
    file.write_text(json.dumps(as_redacted_json(flight)))
    again = spec("--spec", str(file), "--cost-limit", "2")
    assert again.accounts == replace(flight.accounts, cost_limit_usd=2.0)


def test_each_replayed_reply_names_the_model_that_served_it(tmp_path):
    decisions = [{**row, "step": k} for k, row in enumerate([SAID[0]] * 4)]
    decisions[1] |= {"served": "m-1 fp_1"}
    decisions[3] |= {"served": "m-1 fp_2"}
    recording = spec("--sitl", "--model", f"replay:{folder(tmp_path, decisions=decisions)}").replay
    assert recording is not None
    assert [step.served for step in recording.steps] == [None, "m-1 fp_1", "m-1 fp_1", "m-1 fp_2"]


def test_replayed_commander_replies_name_the_model_that_served_them(tmp_path):
    run = folder(tmp_path)
    exchange = {"t_asked": 0.0, "t_answered": 1.0, "causes": [], "roster": "", "frames": [], "reply": "{}",
                "orders": [], "confirms": [], "model": "m"}  # fmt: skip
    changes: list[dict[str, str]] = [{}, {"served": "m-1 fp_1"}, {}, {"served": "m-1 fp_2"}]
    lines = [json.dumps({"number": k, **exchange, **each}) for k, each in enumerate(changes)]
    (run / EASY / "commander.jsonl").write_text("\n".join(lines) + "\n")
    recording = spec("--sitl", "--model", f"replay:{run}").replay
    assert recording is not None
    commander = [each.served for each in recording.steps if each.role == "commander"]
    assert commander == [None, "m-1 fp_1", "m-1 fp_1", "m-1 fp_2"]
