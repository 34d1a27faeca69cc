"""Deciders: one question covers one drone or several, and each group has its own clock."""

import dataclasses
import itertools
import json

import pytest

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.latency import LatencyPolicy, Question
from dronecats.agent.loop import PaperAgent, Questions
from dronecats.agent.models.model import Reply
from dronecats.agent.pictures import PicturePath
from dronecats.agent.prompt import Prompt
from dronecats.agent.reply.reading import ReplyParser
from foundation.run_folder.writing import LineLog
from foundation.threads import InlineExecutor
from tests.agent.flown_wire import CAMERA, Clock, Views
from tests.support.charged import Charged


class Noting:
    """A model that records the number of images per question and turns each drone a little."""

    name = "noting"

    def __init__(self):
        self.asked = []

    def ask(self, request):
        count = len(request.images_jpeg)
        self.asked.append(count)
        turn = {"action": "rotate", "angle_deg": 30}
        return Reply(json.dumps(turn if count == 1 else [turn] * count), 0.1)

    def check(self):
        pass

    def close(self):
        pass


def fly(folder, groups, policy, seconds=30.0, model=None, pictures=None, aircraft=None):
    """Fly three drones with deciders for these groups; return (decisions, number of images per question)."""
    folder.mkdir()
    model, log = model or Noting(), LineLog(folder / "decisions.jsonl")
    cockpit = Cockpit(
        aircraft=aircraft or [Clock() for _ in range(3)], camera=Views(90, 160), camera_model=CAMERA, log=log,
        frames_dir=folder, executor=InlineExecutor(), t0_us=0, pictures=pictures,
    )  # fmt: skip
    PaperAgent(Questions(model, Prompt.load(None), "go", policy), cockpit, groups).fly(seconds)
    log.close()
    return [json.loads(line) for line in (folder / "decisions.jsonl").read_text().splitlines()], model.asked


def test_one_decider_asks_for_all_its_drones_at_once(tmp_path):
    aircraft = [Clock() for _ in range(3)]
    decisions, batch_sizes = fly(tmp_path / "run", None, LatencyPolicy.parse("fixed:0.5"), aircraft=aircraft)
    assert all(each.flown for each in aircraft)
    assert set(batch_sizes) == {3}
    assert [d["drone"] for d in decisions[:6]] == [0, 1, 2, 0, 1, 2]
    assert [d["step"] for d in decisions[:6]] == [0, 0, 0, 1, 1, 1]


def test_separate_deciders_have_separate_clocks(tmp_path):
    def charge(question):
        return 1.0 + 2.0 * question.drone

    decisions, batch_sizes = fly(tmp_path / "run", [[0], [1], [2]], Charged((), charge))
    assert set(batch_sizes) == {1}
    counts = [sum(d["drone"] == drone for d in decisions) for drone in range(3)]
    assert counts[0] > counts[1] > counts[2] > 2  # faster replies lead to more questions
    assert len({d["step"] for d in decisions}) == len(decisions)  # every question has its own number
    assert [d["t_decided"] for d in decisions] == sorted(d["t_decided"] for d in decisions)
    for drone in range(3):
        own = [d for d in decisions if d["drone"] == drone]
        for before, after in itertools.pairwise(own):  # a turn of 30° at 60°/s precedes each question
            assert after["t_decided"] - before["t_decided"] > 0.5 + charge(Question((0,), 0, drone)) - 0.06


def test_a_cap_limits_the_decision_rate_of_every_decider(tmp_path):
    """The cap allows one decision per 4 s. A turn and its reply take only about 1 s."""
    for name, groups in (("together", None), ("apart", [[0], [1, 2]])):
        decisions, _ = fly(tmp_path / name, groups, LatencyPolicy.parse("fixed:0.3+cap:0.25"))
        for drone in range(3):
            decided = [d["t_decided"] for d in decisions if d["drone"] == drone]
            assert decided[0] < 1.0  # the cap does not delay the first decision
            for before, after in itertools.pairwise(decided):
                assert 4.0 - 1e-6 <= after - before < 4.2
            assert len(decided) == 8


def test_drones_have_separate_random_draws(tmp_path):
    """Drones of separate questions have separate draws of reply times and lost images."""
    replies, _ = fly(tmp_path / "replies", [[0], [1], [2]], LatencyPolicy.parse("lognormal:1,0.7"))
    drawn = [tuple(d["latency_s"] for d in replies if d["drone"] == drone)[:4] for drone in range(3)]
    assert len(set(drawn)) == 3

    draws = []

    class Noted(PicturePath):
        def drawn(self, question, drone):
            draws.append((question.drone, drone))
            return super().drawn(question, drone)

    fly(tmp_path / "pictures", [[0], [1, 2]], LatencyPolicy.parse("fixed:0.5"), pictures=Noted(dropped=0.2))
    assert set(draws) == {(0, 0), (1, 1), (1, 2)}


def test_deciders_of_one_and_of_two_drones_fly_side_by_side(tmp_path):
    decisions, batch_sizes = fly(tmp_path / "run", [[0], [1, 2]], LatencyPolicy.parse("fixed:0.5"))
    assert set(batch_sizes) == {1, 2}
    together = [d for d in decisions if d["drone"] > 0]
    assert [d["drone"] for d in together[:4]] == [1, 2, 1, 2]
    assert together[0]["step"] == together[1]["step"] != together[2]["step"]


class Sloppy(Noting):
    """A model that writes Python, and one object for the first drone only."""

    name = "sloppy"

    def ask(self, request):
        return Reply("[{'action': 'rotate', 'angle_deg': '30°'}]", 0.1)


def test_only_the_lenient_parser_logs_repairs(tmp_path):
    cases: list[tuple[ReplyParser, list[str] | None]] = [
        ("lenient", ["single_quotes", "number_text", "unit", "short"]), ("strict", None),
    ]  # fmt: skip
    for parser, mended in cases:
        log = LineLog(tmp_path / f"{parser}.jsonl")
        cockpit = Cockpit(
            aircraft=[Clock() for _ in range(2)], camera=Views(90, 160), camera_model=CAMERA, log=log,
            frames_dir=tmp_path, executor=InlineExecutor(), t0_us=0,
        )  # fmt: skip
        policy = LatencyPolicy.parse("fixed:0.5")
        PaperAgent(Questions(Sloppy(), Prompt.load(None), "go", policy, parser=parser), cockpit, None).fly(5.0)
        log.close()
        first, second = (json.loads(line) for line in (tmp_path / f"{parser}.jsonl").read_text().splitlines()[:2])
        assert first.get("mended") == mended
        assert (first["action"] is None) == (parser == "strict")
        assert second["action"] is None
        assert "mended" not in second or second["mended"] == ["single_quotes", "short"]
        assert second["error"]


class Updated(Noting):
    """A model whose vendor replaces its version during the flight."""

    served_names = (None, "noting fp_1", "noting fp_1", "noting fp_2", None)

    def ask(self, request):
        reply = super().ask(request)
        return dataclasses.replace(reply, served=self.served_names[min(len(self.asked), len(self.served_names)) - 1])


def test_the_served_model_is_logged_only_when_it_changes(tmp_path):
    decisions, _ = fly(tmp_path / "run", None, LatencyPolicy.parse("fixed:0.5"), model=Updated())
    served = [d.get("served") for d in decisions if d["drone"] == 0]
    assert served[:6] == [None, "noting fp_1", None, "noting fp_2", "noting", None]
    assert [d.get("served") for d in decisions if d["drone"] == 2] == served
    plain, _ = fly(tmp_path / "plain", None, LatencyPolicy.parse("fixed:0.5"))
    assert not [d for d in plain if "served" in d]


@pytest.mark.parametrize("policy", ["fixed:40", "trace"])
def test_first_reply_after_the_cap_is_logged_and_has_no_effect(tmp_path, policy):
    """A slow model fails the episode. Only an endpoint without a reply is an error, and such a flight is not scored."""
    latency = LatencyPolicy.parse(policy) if policy != "trace" else Charged((), lambda question: 40.0)
    aircraft = [Clock() for _ in range(3)]
    decisions, batch_sizes = fly(tmp_path / "run", None, latency, aircraft=aircraft)
    assert batch_sizes == [3]
    assert [each.flown for each in aircraft] == [[], [], []]
    assert [decision["drone"] for decision in decisions] == [0, 1, 2]
    assert {decision["t_decided"] for decision in decisions} == {40.0}
