"""Latency policies: the distributions, the independence of the draws, and the parser."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from dronecats.agent.latency import (
    COMMANDER,
    KINDS,
    LONGEST_S,
    Circumstance,
    LatencyPolicy,
    Question,
    split_policy,
    trace_name,
)
from dronecats.agent.loop import PendingQuestion
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.pictures import PicturePath
from dronecats.pilots.oracle.noisy import NoisyPilot
from dronecats.pilots.oracle.oracle import TrueState
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.threads import InlineExecutor
from tests.support.refusal import refusal

RECORDED = (0.4, 1.5, 0.7, 2.25, 0.31)
TRACE = f"trace:{trace_name(RECORDED)}"
RANDOM = ["lognormal:1,0.7", "gamma:2,0.8", "bimodal:0.1,3,0.5", "jitter:2,0.5,0.4", "stall:0.5,5"]
SEEDS, STEPS = 400, 5


def charged(policy: str, question: Question, reply: Reply | None = None, since_s: float | None = None) -> float:
    read = LatencyPolicy.parse(policy, RECORDED if TRACE in policy else None)
    return read.charge_s(question, Circumstance(reply, since_s))


def draws(policy: str, seeds: int = SEEDS, steps: int = STEPS) -> Any:
    """Return (seeds, steps) latencies of one drone."""
    return np.array([[charged(policy, Question((seed, 7), step, 0)) for step in range(steps)] for seed in range(seeds)])


def sigma_of(cv: float) -> float:
    return math.sqrt(math.log1p(cv * cv))


@pytest.mark.parametrize(
    ("policy", "expected"),
    [
        ("lognormal:0.5,0.6", stats.lognorm(0.6, scale=0.5)),
        ("gamma:2,0.5", stats.gamma(4.0, scale=0.5)),
        ("gamma:0.8,1", stats.expon(scale=0.8)),
        ("gamma:1,2", stats.gamma(0.25, scale=4.0)),
        ("jitter:2,0.5", stats.lognorm(sigma_of(0.5), scale=0.5 * math.exp(-(sigma_of(0.5) ** 2) / 2))),
        ("jitter:0.5,1,0.9", stats.lognorm(sigma_of(1.0), scale=2.0 * math.exp(-(sigma_of(1.0) ** 2) / 2))),
    ],
)
def test_draws_have_the_requested_distribution(policy, expected):
    drawn = draws(policy, 600, 3)
    for step in (0, 2):  # different seeds, so that the samples are independent
        assert stats.kstest(drawn[:, step], expected.cdf).pvalue > 0.003
    assert np.median(drawn) == pytest.approx(expected.median(), rel=0.15)


def test_gamma_has_the_requested_mean_and_spread_and_is_constant_without_spread():
    drawn = draws("gamma:3,0.4", 500, 4)
    assert drawn.mean() == pytest.approx(3.0, rel=0.03)
    assert drawn.std() == pytest.approx(1.2, rel=0.06)
    assert set(draws("gamma:3,0", 5, 2).ravel()) == {3.0}


def test_jitter_has_the_requested_mean_spread_and_autocorrelation():
    drawn = draws("jitter:2,0.5,0.8", 40, 120)
    assert drawn.mean() == pytest.approx(0.5, rel=0.06)
    assert drawn.std() / drawn.mean() == pytest.approx(0.5, rel=0.12)
    logs = np.log(drawn)
    for rho, lag in ((0.8, 1), (0.64, 2)):
        assert np.corrcoef(logs[:, :-lag].ravel(), logs[:, lag:].ravel())[0, 1] == pytest.approx(rho, abs=0.05)
    alone = np.log(draws("jitter:2,0.5", 20, 100))
    assert abs(np.corrcoef(alone[:, :-1].ravel(), alone[:, 1:].ravel())[0, 1]) < 0.08
    assert draws("jitter:4,0", 2, 3) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("policy", "rare_s", "often_s", "share"),
    [("bimodal:0.2,4,0.75", 4.0, 0.2, 0.25), ("stall:0.1,6", 6.0, 0.0, 0.1), ("stall:0,6", 6.0, 0.0, 0.0)],
)
def test_rare_events_have_the_requested_probability(policy, rare_s, often_s, share):
    drawn = draws(policy)
    assert set(drawn.ravel()) <= {rare_s, often_s}
    rare, total = int((drawn == rare_s).sum()), drawn.size
    assert stats.binomtest(rare, total, share).pvalue > 0.003
    following = drawn[:, 1:][drawn[:, :-1] == rare_s] == rare_s  # each is independent of the next
    assert following.size == 0 or stats.binomtest(int(following.sum()), following.size, share).pvalue > 0.003


def test_a_higher_stall_probability_stalls_a_superset_of_the_questions():
    few, many = draws("stall:0.1,5"), draws("stall:0.3,5")
    assert ((few > 0) <= (many > 0)).all()
    assert (many > 0).sum() > (few > 0).sum()


def test_a_trace_is_replayed_cyclically_from_a_random_start():
    latencies = draws(TRACE, 60, 12)
    begins = set()
    for replayed in latencies:
        begin = RECORDED.index(replayed[0])
        begins.add(begin)
        assert list(replayed) == [RECORDED[(begin + k) % len(RECORDED)] for k in range(12)]
    assert begins == set(range(len(RECORDED)))


def test_token_latency_uses_the_count_or_else_four_characters_per_token():
    question = Question((0,), 0, 0)
    assert charged("tokens:0.4,50", question, Reply("{}", 9.0, tokens_out=200)) == pytest.approx(4.4)
    assert charged("tokens:0.4,50", question, Reply("x" * 41, 9.0)) == pytest.approx(0.4 + 11 / 50)
    assert charged("tokens:0.4,0.1", question, Reply("", 9.0, tokens_out=10**6)) == LONGEST_S
    assert charged("measured+fixed:1", question, Reply("", 9.0)) == 10.0


class FixedReply:
    """A model with one reply."""

    name = "said"

    def __init__(self, reply):
        self.reply = reply

    def ask(self, request):
        return self.reply

    def check(self):
        pass

    def close(self):
        pass


@pytest.mark.parametrize(("last_s", "due_s"), [(None, 10.3), (9.5, 14.5), (2.0, 10.3), (5.3, 10.3)])
def test_a_rate_cap_delays_a_reply_until_one_period_after_the_last_reply(last_s, due_s):
    asking = PendingQuestion(
        FixedReply(Reply("{}", 0.0)), Request("p", (b"",), False), InlineExecutor(),
        LatencyPolicy.parse("fixed:0.3+cap:0.2"),
        Question((0,), 4, 0), 10.0, False, last_s,
    )  # fmt: skip
    assert not asking.due(due_s - 0.01)
    assert asking.due(due_s)
    assert asking.latency_s(due_s) == pytest.approx(due_s - 10.0)


@pytest.mark.parametrize("policy", [*RANDOM, TRACE])
def test_a_draw_depends_only_on_the_question(policy):
    question = Question((1, 2), 30, 0)
    others = {
        "step": [Question((1, 2), step, 0) for step in range(31, 50)],
        "drone": [Question((1, 2), 30, drone) for drone in range(1, 20)],
        "flight": [Question((1, seed), 30, 0) for seed in range(3, 22)],
        "episode": [Question((seed, 2), 30, 0) for seed in range(2, 21)],
    }
    alone = charged(policy, question)
    for questions in others.values():
        assert len({charged(policy, other_question) for other_question in questions}) > 1
    assert charged(policy, question) == alone


def test_added_policies_have_independent_draws():
    questions = [Question((3, 1), step, 0) for step in range(300)]
    for base in ("lognormal:1,0.5", "gamma:1,0.5", "jitter:1,0.5"):
        both = np.array([charged(f"{base}+stall:0.5,200", question) for question in questions])
        own = np.array([charged(base, question) for question in questions])
        stalled = both > own + 100.0
        assert both[~stalled] == pytest.approx(own[~stalled], abs=1e-12)
        assert both[stalled] == pytest.approx(own[stalled] + 200.0, abs=1e-9)
        assert stats.ks_2samp(own[stalled], own[~stalled]).pvalue > 0.003


def test_different_kinds_of_draws_never_share_a_random_state():
    """Latency policies, image faults and the noisy pilot never start from the same random state."""
    streams: dict[str, set[Any]] = {}
    begun = np.random.default_rng

    def noted(key: Any) -> np.random.Generator:
        made = begun(key)
        streams.setdefault(name, set()).add(str(made.bit_generator.state))
        return made

    pilot, pictures = NoisyPilot("go to the red car", (3, 1)), PicturePath()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("numpy.random.default_rng", noted)
        for step, drone in itertools.product(range(12), (0, 1, 2, 3, COMMANDER)):
            question = Question((3, 1), step, drone)
            for policy in (*RANDOM, TRACE):
                name = policy
                charged(policy, question)
            for seen in range(4):
                name = "pictures"
                pictures.drawn(question, seen)
            name = "noisy"
            at = TrueState(
                (0.0,) * 3, 0.0, (1.0, 0.0, 0.0, 0.0), (20.0, 0.0, 0.0), (0.0,) * 3, CameraModel(), drone, step, True
            )
            pilot([at])
    assert len(streams) == len(RANDOM) + 3
    for first, second in itertools.combinations(streams, 2):
        assert not streams[first] & streams[second], (first, second)


BOUNDS = {name: [(each.low, each.high) for each in kind.quantities] for name, kind in KINDS.items() if kind.quantities}


@st.composite
def policies(draw: Any) -> list[str]:
    names = draw(st.lists(st.sampled_from(sorted(BOUNDS)), min_size=1, max_size=4, unique=True))
    words = []
    for name in names:
        bounds = BOUNDS[name][: len(BOUNDS[name]) - draw(st.integers(0, KINDS[name].optional))]
        words.append(f"{name}:{','.join(repr(draw(st.floats(low, high))) for low, high in bounds)}")
    return words


@given(policies(), st.integers(0, 2**31 - 1), st.integers(0, 40), st.integers(0, 255))
def test_a_valid_policy_is_parsed_and_charges_the_sum_of_its_parts(words, seed, step, drone):
    text = "+".join(words)
    assert split_policy(text) == words
    policy, question, reply = LatencyPolicy.parse(text), Question((seed, 1), step, drone), Reply("abc", 1.0)
    assert str(policy) == text
    assert policy.foreseen == ("tokens" not in text)
    own = [charged(word, question, reply) for word in words]
    assert all(0.0 <= charge <= LONGEST_S for charge in own)
    assert charged(text, question, reply) == pytest.approx(sum(own), abs=1e-9)  # a first reply is not held back


@given(
    st.one_of(
        st.text(max_size=30),
        st.builds(
            lambda name, numbers: f"{name}:{','.join(map(repr, numbers))}",
            st.sampled_from([*KINDS, "real", "exp"]), st.lists(st.floats(), max_size=4),
        ),
    )
)  # fmt: skip
def test_any_text_is_rejected_or_gives_a_nonnegative_charge(text):
    try:
        policy = LatencyPolicy.parse(text)
    except UsageError:
        return
    assert policy.real or policy.charge_s(Question((0,), 0, 0), Circumstance(Reply("", 0.0))) >= 0.0


def test_errors_in_a_policy_are_named():
    for text, word in [
        ("gamma:1", "gamma:MEAN,CV"),
        ("bimodal:1,2,3", "SHARE"),
        ("jitter:2,0.5,1", "RHO"),
        ("fixed:1+real", "--latency real"),
        ("stall:0.1,5+stall:0.2,1", "twice"),
        ("poisson:1", "fixed:SECONDS"),
        ("measured:1", "--latency measured"),
        ("trace:runs/x", "file"),
    ]:
        assert word in refusal(LatencyPolicy.parse, text)


def test_a_different_empty_or_invalid_trace_is_rejected():
    for trace, word in (((0.4,), trace_name((0.4,))), ((), "10,000"), ((301.0,), "300"), ((math.nan,), "300")):
        assert word in refusal(LatencyPolicy.parse, TRACE, trace)
    assert "latency_trace" in refusal(LatencyPolicy.parse, "fixed:1", RECORDED)
