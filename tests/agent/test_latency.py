from concurrent.futures import Executor, Future

import pytest

from dronecats.agent.latency import Asking, InlineExecutor, latency
from dronecats.agent.models.model import Reply, Request
from foundation.errors import ModelError, UsageError

REQUEST = Request("p", (b"",), False)


class Answering:
    name = "answering"

    def __init__(self, latency_s=0.2, error=None):
        self.latency_s, self.error = latency_s, error

    def ask(self, request):
        if self.error:
            raise self.error
        return Reply("{}", self.latency_s)

    def close(self):
        pass


class Later(Executor):
    """An executor whose call is still under way."""

    def __init__(self):
        self.future: Future[Reply] = Future()

    def submit(self, fn, /, *args, **kwargs):
        return self.future


@pytest.mark.parametrize(("policy", "due_s"), [("measured", 10.2), ("fixed:1.5", 11.5), ("fixed:0", 10.0)])
def test_latency_is_charged_on_the_vehicles_clock(policy, due_s):
    asking = Asking(Answering(), REQUEST, InlineExecutor(), latency(policy), 10.0)
    assert not asking.due(due_s - 0.01) or due_s == 10.0
    assert asking.due(due_s)
    assert asking.latency_s(due_s + 0.05) == pytest.approx(due_s - 10.0)


def test_a_reply_that_comes_after_its_charge_is_written_down_as_late_as_it_was():
    asking = Asking(Answering(3.0), REQUEST, InlineExecutor(), latency("fixed:0.5"), 10.0)
    assert asking.latency_s(13.0) == pytest.approx(3.0)
    passing = Asking(Answering(0.2), REQUEST, InlineExecutor(), latency("real"), 10.0)
    assert passing.latency_s(10.8) == pytest.approx(0.8)


def test_a_slow_call_is_never_due_before_it_has_come_back():
    later = Later()
    asking = Asking(Answering(), REQUEST, later, latency("fixed:0.5"), 0.0)
    assert not asking.due(100.0)
    later.future.set_result(Reply("{}", 3.0))
    assert asking.due(100.0)


def test_an_error_is_due_at_once_and_raised():
    asking = Asking(Answering(error=ModelError("gone")), REQUEST, InlineExecutor(), latency("fixed:9"), 0.0)
    assert asking.due(0.0)
    with pytest.raises(ModelError, match="gone"):
        asking.reply()


@pytest.mark.parametrize("text", ["", "fast", "fixed:", "fixed:x", "fixed:-1", "fixed:nan", "fixed:301"])
def test_wrong_policies_are_refused(text):
    with pytest.raises(UsageError, match="--latency"):
        latency(text)
