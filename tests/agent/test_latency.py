import math
import statistics
import threading
from concurrent.futures import Executor, Future

import pytest

from dronecats.agent.latency import LONGEST_S, LatencyPolicy, Question
from dronecats.agent.loop import PendingQuestion
from dronecats.agent.models.model import Reply, Request
from foundation.errors import ModelError
from foundation.threads import InlineExecutor
from tests.support.charged import Charged
from tests.support.refusal import refusal

REQUEST = Request("p", (b"",), False)
FIRST = Question((0,), 0, 0)


class Answering:
    name = "answering"

    def __init__(self, latency_s=0.2, error=None):
        self.latency_s, self.error = latency_s, error

    def ask(self, request):
        if self.error:
            raise self.error
        return Reply("{}", self.latency_s)

    def check(self):
        pass

    def close(self):
        pass


class Later(Executor):
    """An executor whose call is still in progress."""

    def __init__(self):
        self.future: Future[Reply] = Future()

    def submit(self, fn, /, *args, **kwargs):
        return self.future


@pytest.mark.parametrize(("policy", "due_s"), [("measured", 10.2), ("fixed:1.5", 11.5), ("fixed:0", 10.0)])
def test_latency_is_charged_on_the_vehicles_clock(policy, due_s):
    asking = PendingQuestion(Answering(), REQUEST, InlineExecutor(), LatencyPolicy.parse(policy), FIRST, 10.0)
    assert not asking.due(due_s - 0.01) or due_s == 10.0
    assert asking.due(due_s)
    assert asking.latency_s(due_s + 0.05) == pytest.approx(due_s - 10.0)


def test_a_reply_later_than_its_charge_has_its_actual_latency():
    asking = PendingQuestion(Answering(3.0), REQUEST, InlineExecutor(), LatencyPolicy.parse("fixed:0.5"), FIRST, 10.0)
    assert asking.latency_s(13.0) == pytest.approx(3.0)
    passing = PendingQuestion(Answering(0.2), REQUEST, InlineExecutor(), LatencyPolicy.parse("real"), FIRST, 10.0)
    assert passing.latency_s(10.8) == pytest.approx(0.8)


def test_a_call_is_not_due_before_it_returns():
    later = Later()
    asking = PendingQuestion(Answering(), REQUEST, later, LatencyPolicy.parse("fixed:0.5"), FIRST, 0.0)
    assert not asking.due(100.0)
    later.future.set_result(Reply("{}", 3.0))
    assert asking.due(100.0)


def test_an_error_is_due_at_once_and_raised():
    asking = PendingQuestion(
        Answering(error=ModelError("gone")), REQUEST, InlineExecutor(), LatencyPolicy.parse("fixed:9"), FIRST, 0.0
    )
    assert asking.due(0.0)
    with pytest.raises(ModelError, match="gone"):
        asking.reply()


def test_invalid_policies_are_rejected():
    for text in [
        "",
        "fast",
        "fixed:",
        "fixed:x",
        "fixed:-1",
        "fixed:nan",
        "fixed:301",
        "fixed:1,2",
        "lognormal:1",
        "lognormal:0,1",
        "lognormal:1,-1",
    ]:
        assert "--latency" in refusal(LatencyPolicy.parse, text)


def draw(policy, question):
    asking = PendingQuestion(Answering(), REQUEST, InlineExecutor(), LatencyPolicy.parse(policy), question, 0.0)
    return asking.latency_s(0.0)


def test_a_drawn_latency_depends_only_on_the_question():
    policy = "lognormal:1,0.7"
    assert draw(policy, Question((1, 2), 3, 0)) == draw(policy, Question((1, 2), 3, 0))
    others = [Question((1, 2), 4, 0), Question((1, 2), 3, 1), Question((1, 3), 3, 0), Question((2, 2), 3, 0)]
    assert len({draw(policy, question) for question in [Question((1, 2), 3, 0), *others]}) == 5


def test_a_latency_is_drawn_once_per_question():
    drawn = []

    def charge(question):
        drawn.append(question)
        return 1.0 + 0.1 * len(drawn)

    policy = Charged((), charge)
    asking = PendingQuestion(Answering(), REQUEST, InlineExecutor(), policy, FIRST, 0.0)
    due = [asking.due(0.05 * tick) for tick in range(40)]
    assert due == [0.05 * tick >= 1.1 - 1e-9 for tick in range(40)]
    assert asking.latency_s(1.1) == 1.1
    assert drawn == [FIRST]


class Thinking(Answering):
    """Answers when `may_answer` is set."""

    def __init__(self):
        super().__init__(latency_s=7.0)
        self.asked, self.may_answer = threading.Event(), threading.Event()

    def ask(self, request):
        self.asked.set()
        assert self.may_answer.wait(30.0)
        return super().ask(request)


def test_the_clock_advances_during_a_parallel_question_until_its_reply_is_due():
    model = Thinking()
    asking = PendingQuestion(
        model, REQUEST, InlineExecutor(), LatencyPolicy.parse("fixed:0.5"), FIRST, 0.0, beside=True
    )
    assert model.asked.wait(30.0)
    assert not asking.due(0.0)
    assert not asking.due(0.45)
    assert not asking._future.done()
    model.may_answer.set()
    assert asking.due(0.5)
    assert asking.reply().text == "{}"
    assert asking.latency_s(0.5) == 0.5


def test_an_early_error_is_raised_only_when_the_reply_is_due():
    """The arrival time of the error depends on the machine, and a flight must be reproducible."""
    asking = PendingQuestion(
        Answering(error=ModelError("gone")),
        REQUEST,
        InlineExecutor(),
        LatencyPolicy.parse("fixed:1"),
        FIRST,
        0.0,
        beside=True,
    )
    assert asking.answered
    assert not asking.due(0.95)
    assert asking.due(1.0)
    with pytest.raises(ModelError, match="gone"):
        asking.reply()


@pytest.mark.parametrize("policy", ["measured", "real"])
def test_questions_with_unpredictable_latency_are_not_asked_in_parallel(policy):
    asked_by = []

    class Here(Answering):
        def ask(self, request):
            asked_by.append(threading.current_thread())
            return super().ask(request)

    PendingQuestion(Here(), REQUEST, InlineExecutor(), LatencyPolicy.parse(policy), FIRST, 0.0, beside=True)
    assert asked_by == [threading.current_thread()]


def test_drawn_latencies_have_the_requested_median_and_spread():
    logarithms = [math.log(draw("lognormal:2,0.5", Question((9,), step, 0))) for step in range(400)]
    assert statistics.median(logarithms) == pytest.approx(math.log(2.0), abs=0.1)
    assert statistics.pstdev(logarithms) == pytest.approx(0.5, rel=0.15)
    assert max(draw("lognormal:300,3", Question((9,), step, 0)) for step in range(20)) == LONGEST_S
