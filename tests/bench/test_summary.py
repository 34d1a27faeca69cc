"""The table of a benchmark and its progress line, compared with an independent count."""

import json
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.agent.latency import Circumstance, LatencyPolicy, Question
from dronecats.agent.models.ledger import Spent
from dronecats.agent.models.model import Reply
from dronecats.bench.progress import Progress
from dronecats.bench.tables import EpisodeScore, bench_rows, bench_table, broken_pins, score
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.judge.statistics.shares import estimate_share, wilson
from dronecats.report.writers import as_terminal
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder.results import Result
from foundation.run_folder.rows import Decision
from tests.judge.episode_logs import decision

IDS = ["residential-approaching-01", "residential-approaching-02", "campus-tracking-01", "blocks-commanding-01"]


@st.composite
def scores(draw):
    """Draw flights. An episode may have several."""
    one = st.builds(
        EpisodeScore,
        setting=st.sampled_from(["a", "b"]),
        episode=st.sampled_from(IDS),
        outcome=st.sampled_from(["success", "failure", "error"]),
        retried=st.booleans(),
        stalled=st.booleans(),
        rates_hz=st.lists(st.floats(0.01, 10.0), max_size=5).map(tuple),
        broken_pins=st.integers(0, 3),
        unreadable=st.integers(0, 9),
    )
    return draw(st.lists(one, max_size=25))


@settings(deadline=None)
@given(scores(), st.booleans())
def test_the_table_matches_an_independent_count(flights, drop):
    lines = bench_rows(flights, drop_stalled=drop)
    settings_flown = {each.setting for each in flights}
    assert [line.setting for line in lines if line.group == "all"] == list(dict.fromkeys(e.setting for e in flights))
    assert {line.setting for line in lines} == settings_flown
    for line in lines:
        mine = [
            e for e in flights if e.setting == line.setting and (line.group == "all" or e.episode[:-3] == line.group)
        ]
        kept = [e for e in mine if e.outcome != "error" and not (drop and e.stalled)]
        assert line.flights == len(kept)
        assert line.solved == sum(e.outcome == "success" for e in kept)
        assert line.errors == sum(e.outcome == "error" for e in mine)
        assert line.dropped == (sum(e.stalled for e in mine if e.outcome != "error") if drop else 0)
        assert line.unreadable == sum(e.unreadable for e in kept)
        assert line.retries == sum(e.retried for e in mine)
        low, high = line.interval
        assert (line.share is None) == (not kept)
        assert low - 1e-4 <= (line.solved / line.flights if kept else low) <= high + 1e-4
        rates = sorted(rate for e in kept for rate in e.rates_hz)
        assert (line.rate_hz is None) == (not rates)
        if line.rate_hz:
            assert line.rate_hz[1] == pytest.approx(float(np.median(rates)), abs=1e-3)
            assert list(line.rate_hz) == sorted(line.rate_hz)
        json.dumps(asdict(line))
    text = as_terminal(bench_table(lines))
    explained = any(line.unreadable for line in lines)
    assert len(text.splitlines()) == len(lines) + len(settings_flown) + 4 + explained  # three lines are headers
    assert ("cut off" in text) == explained


FLIGHT = FlightSpec(pilot="oracle", simulated=Simulated(speed=1.0), latency=LatencyPolicy.parse("rate:2"))


def test_a_score_is_computed_from_the_logs_in_its_folder(tmp_path):
    decisions = [
        decision(0, 1, 1.0, latency_s=0.5, rate_hz=None),
        decision(1, 2, 4.0, latency_s=0.5, rate_hz=0.333333),
        decision(2, 3, 9.0, latency_s=2.0, rate_hz=0.2),
    ]
    (tmp_path / "decisions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in decisions))
    result = Result(episode=IDS[0], outcome="success", host_stalls=1)
    scored = score("x", FLIGHT, tmp_path, result, retried=False)
    assert (scored.rates_hz, scored.broken_pins, scored.stalled) == ((0.333333, 0.2), 1, True)
    assert score("x", FLIGHT, tmp_path, Result(episode=IDS[0], outcome="success"), retried=True).stalled is False
    unpinned = replace(FLIGHT, latency=LatencyPolicy.parse("real"))
    assert score("x", unpinned, tmp_path, result, retried=False).broken_pins == 0
    (tmp_path / "decisions.jsonl").write_text("{}\n")
    assert score("x", FLIGHT, tmp_path, result, retried=False).rates_hz == ()


def test_a_joint_reply_counts_once_in_the_control_rate_and_replies_after_the_cap_do_not_count(tmp_path):
    decisions = [decision(0, 1, 5.0, drone=drone, rate_hz=None) for drone in range(2)]
    decisions += [decision(1, 2, 10.0, drone=drone, rate_hz=0.2) for drone in range(2)]
    decisions += [decision(2, 3, CAP_S, rate_hz=0.1), decision(3, 4, CAP_S + 0.1, rate_hz=0.05)]
    (tmp_path / "decisions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in decisions))
    scored = score("x", FLIGHT, tmp_path, Result(episode=IDS[3], outcome="failure"), retried=False)
    assert scored.rates_hz == (0.2, 0.1)


def test_unreadable_replies_are_counted_by_reason(tmp_path):
    decisions = [
        decision(0, 1, 1.0),
        decision(1, 2, 2.0, action=None, error="no JSON"),
        decision(2, 3, 3.0, action=None, error="no JSON", finish="refusal"),
        decision(3, 4, 4.0, action=None, error="no JSON", finish="filtered"),
        decision(4, 5, 5.0, action=None, error="no JSON", finish="length"),
        decision(5, 6, 6.0, finish="length"),  # the action is readable although the reply was cut off
    ]
    (tmp_path / "decisions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in decisions))
    scored = score("x", FLIGHT, tmp_path, Result(episode=IDS[0], outcome="failure"), retried=False)
    assert (scored.unreadable, scored.refused, scored.cut_off) == (4, 2, 1)
    assert re.search(r"\b4 +2 +1\b", as_terminal(bench_table(bench_rows([scored]))))


def test_the_progress_line_has_the_same_interval_as_the_table():
    outcomes = [("a", True), ("a", True), ("a", True), ("b", False), ("b", False), ("b", False)]
    progress = Progress(total=9)
    for episode, won in outcomes:
        progress.stored(Result(episode=episode, outcome="success" if won else "failure"))
    interval = estimate_share([[True] * 3, [False] * 3])
    assert f"SR 50% ({interval.low:.0%}–{interval.high:.0%})" in progress.line(0.0)
    assert (interval.low, interval.high) != wilson(3, 6)


def test_a_pinned_rate_charges_its_period_and_later_replies_break_the_pin():
    policy = LatencyPolicy.parse("rate:3")
    charged_s = policy.charge_s(Question((0,), 0, 0), Circumstance(Reply("", 17.0)))
    assert charged_s == pytest.approx(1 / 3)
    kept = Decision(step=0, drone=0, frame_id=0, t_frame=0.0, t_decided=1.0, action=None, latency_s=round(charged_s, 6))
    assert broken_pins(policy, [kept]) == 0
    late = replace(kept, latency_s=0.5)
    assert broken_pins(policy, [kept, late]) == 1
    assert broken_pins(policy, [late, replace(late, drone=1), replace(late, step=1)]) == 2  # a joint reply counts once
    assert broken_pins(LatencyPolicy.parse("rate:3+stall:0.1,5"), [kept, replace(kept, latency_s=0.5)]) == 0
    for wrong in ("rate:0", "rate:-1", "rate:21", "rate:nan", "rate:", "rate:1,2"):
        with pytest.raises(UsageError, match="--latency rate:HZ"):
            LatencyPolicy.parse(wrong)


def test_the_progress_line_shows_progress_and_cost():
    progress = Progress(total=8)
    assert re.findall(r"[\d.]+", progress.line(0.0)) == ["0", "8", "0", "0", "0"]
    progress.stored(Result(episode="z", outcome="success"))
    assert progress.left_s(10.0) is None  # flights of an earlier run do not count for the pace
    progress.add(Result(episode="a", outcome="failure"), again=True)
    progress.add(Result(episode="a", outcome="failure"), again=False)
    progress.add(Result(episode="b", outcome="error"), again=False)
    line = progress.line(60.0, Spent(3, 1000, 234, 1.5))
    for part in (
        "3/8",
        "50% (9%–91%)",
        "1 solved",
        "1 failed",
        "1 error",
        "1,234 tokens",
        "$1.50",
        "180 ",
        "1 min 40 s left",
    ):
        assert part in line, part
    assert progress.per_hour(60.0) == 180.0
    for wall_s, clock in ((0.01, "1 s"), (36.0, "1 min 00 s"), (3600.0, "1 h 40 min"), (36000.0, "16 h 40 min")):
        assert f"{clock} left" in progress.line(wall_s)
