"""Flights of a commanding episode, hierarchical and solo: records, verdicts, and repeats with the same bytes."""

import json

import pytest

from dronecats.agent.commanding.command_prompt import CommandPrompt
from dronecats.agent.latency import LatencyPolicy
from dronecats.cli.main import main
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.judge.metrics.judging import Judging, judged_episode
from dronecats.pilots import scripted as commander
from foundation.errors import UsageError
from foundation.run_folder.reading import exchanges
from tests.foundation.run_folder.published import check
from tests.support.json_lines import rows

EPISODE = "blocks-commanding-01"
GREY = Simulated(speed=None, rendered=False)


def fly_oracle(out, command, **more):
    """Fly the oracle with a command mode; return (result, folder)."""
    spec = FlightSpec(pilot="oracle", episode=EPISODE, command=command, simulated=GREY, **more)
    return fly(spec, out, lambda line: None), out / EPISODE


def test_a_commander_gives_each_drone_its_own_place_and_confirms_a_declaration(tmp_path):
    result, folder = fly_oracle(tmp_path / "first", "hierarchical", latency=LatencyPolicy.parse("lognormal:0.4,0.5"))
    assert (result["outcome"], result["declarations"]) == ("success", 1)
    commander_log, decisions = exchanges(folder), rows(folder / "decisions.jsonl")
    assert {order.drone: commander.place_in_goal(order.goal) for order in commander_log[0].orders} == {
        0: 1,
        1: 2,
        2: 3,
        3: 4,
    }
    (confirmed,) = [d for d in decisions if "confirmed_by" in d]
    assert commander_log[-1].confirms == (confirmed["drone"],)
    assert commander_log[-1].frames[confirmed["drone"]] == confirmed["frame_id"]
    assert check(folder / "commander.jsonl") == len(commander_log)
    assert check(folder / "decisions.jsonl") == len(decisions) == result["steps"]
    for frame, drone in ((frame, drone) for exchange in commander_log for drone, frame in enumerate(exchange.frames)):
        assert (folder / "frames" / (f"{frame:06d}_d{drone}.jpg" if drone else f"{frame:06d}.jpg")).exists()
    judged = judged_episode(folder, Judging())
    assert not judged.doubtful
    assert judged.verdict.commanding
    assert judged.verdict.commanding.candidates_neared >= 3
    kept = json.loads((tmp_path / "first" / "run.json").read_text())
    assert kept["commander_prompt_sha256"] == CommandPrompt.load().digest


def test_a_hierarchical_flight_repeats_to_the_same_bytes(tmp_path):
    same = {"drones": 2, "seconds": 8.0, "full": True, "latency": LatencyPolicy.parse("lognormal:0.4,0.5")}
    folder, again = (fly_oracle(tmp_path / name, "hierarchical", **same)[1] for name in ("first", "again"))
    for log in ("truth.jsonl", "decisions.jsonl", "commander.jsonl", "verdict.json"):
        assert (folder / log).read_bytes() == (again / log).read_bytes()


def test_solo_drones_fly_and_declare_without_a_commander(tmp_path):
    result, folder = fly_oracle(tmp_path / "run", "solo", drones=2)
    assert result["outcome"] == "success"
    decisions = rows(folder / "decisions.jsonl")
    assert {d["drone"] for d in decisions} == {0, 1}
    assert len({d["step"] for d in decisions}) == len(decisions)
    assert not any("report" in d or "confirmed_by" in d for d in decisions)
    assert not (folder / "commander.jsonl").exists()
    judged = judged_episode(folder, Judging())
    assert not judged.doubtful


def test_a_drone_at_the_wrong_target_gets_another_order(tmp_path):
    """The only drone flies to the first place from the left, which is not the target. The commander gets its report."""
    result, folder = fly_oracle(tmp_path / "run", "hierarchical", drones=1)
    assert result["outcome"] == "success"
    commander_log = exchanges(folder)
    assert [cause.why for exchange in commander_log for cause in exchange.causes] == ["start", "stall", "report"]
    assert [commander.place_in_goal(order.goal) for exchange in commander_log for order in exchange.orders] == [1, 2]


@pytest.mark.slow("flies a fleet in real time")
def test_a_scripted_commander_gives_orders_in_real_time(tmp_path):
    spec = FlightSpec(
        pilot="blind", episode=EPISODE, command="hierarchical", drones=2, seconds=30.0,
        latency=LatencyPolicy.parse("real"),
        simulated=Simulated(speed=1.0),
    )  # fmt: skip
    result = fly(spec, tmp_path / "run", lambda line: None)
    assert (result["outcome"], result["error"]) == ("failure", None)
    commander_log = exchanges(tmp_path / "run" / EPISODE)
    assert len(commander_log[0].orders) == 2
    assert commander_log[0].model == "scripted:divide"
    assert {d["drone"] for d in rows(tmp_path / "run" / EPISODE / "decisions.jsonl")} == {0, 1}


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (("--commander", "local/m"), "--command hierarchical"),
        (("--command", "hierarchical", "--commander", "scripted:x"), "'scripted:x'"),
        (("--command", "hierarchical", "--commander", "m"), "'m'"),
        (("--command", "hierarchical", "--commander", "local/m"), "--commander-url"),
        (("--command", "hierarchical", "--commander-url", "http://h/v1"), "--commander-url"),
        (("--command", "solo", "--pilot", "blind:straight"), "--command solo"),
    ],
)
def test_conflicting_options_are_reported_in_one_sentence(words, word, tmp_path, capsys):
    assert main(["fly", "--sitl", "--episode", EPISODE, *words, "--out", str(tmp_path / "run")]) == 2
    assert word in capsys.readouterr().err


def test_a_commander_model_requires_rendered_pictures():
    from dronecats.agent.models.spec import ModelSpec

    model = ModelSpec(provider="local", name="m", base_url="http://127.0.0.1:9/v1")
    spec = FlightSpec(pilot="oracle", episode=EPISODE, command="hierarchical", commander=model, simulated=GREY)
    with pytest.raises(UsageError, match="rendering"):
        look_up(spec)
