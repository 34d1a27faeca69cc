"""The budget of a model is checked before each question. Missing token counts are estimated."""

import threading
from contextlib import nullcontext
from dataclasses import replace

import pytest

from dronecats.agent.models.endpoint import RetryPolicy
from dronecats.agent.models.ledger import Budget, BudgetedModel, Ledger, Spent
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import Accounts, FlightSpec, Simulated
from foundation.errors import BudgetError, ModelError
from foundation.threads import DaemonExecutor
from tests.agent.models.faulty_wire import Wire, answer, say
from tests.support.refusal import refusal

UNPRICED = ModelSpec(provider="local", name="c", base_url="http://h/v1")
PRICED = ModelSpec(provider="openai", name="m", base_url="http://127.0.0.1:1/v1", input_usd=2.0, output_usd=8.0)
REQUEST = Request("t" * 400, (b"jpeg",), thinking=False)


class Fixed:
    """Always gives the same reply."""

    name = "m"

    def __init__(self, reply):
        self.reply, self.asked = reply, 0

    def ask(self, request):
        self.asked += 1
        return self.reply

    def check(self):
        pass

    def close(self):
        pass


@pytest.fixture
def ledger(tmp_path):
    opened = Ledger(tmp_path / "ledger.sqlite")
    yield opened
    opened.close()


def test_cost_is_tokens_times_prices_and_the_limit_blocks_the_next_question(ledger):
    model = Fixed(Reply("x", 1.0, tokens_in=100_000, tokens_out=10_000))  # $0.20 and $0.08
    asking = BudgetedModel(model, PRICED, Budget(cost_usd=0.5), ledger)
    asking.ask(REQUEST)
    assert ledger.spent().usd == pytest.approx(0.28)
    asking.ask(REQUEST)
    with pytest.raises(BudgetError, match=r"0\.5.*220,000.*0\.5600.*\b2\b"):
        asking.ask(REQUEST)
    assert model.asked == 2
    BudgetedModel(model, PRICED, Budget(cost_usd=0.6), ledger).ask(REQUEST)  # a larger budget continues


def test_tokens_are_estimated_if_the_endpoint_reports_no_counts(ledger):
    asking = BudgetedModel(Fixed(Reply("y" * 40, 1.0)), PRICED, Budget(tokens=1000), ledger)
    asking.ask(REQUEST)
    assert ledger.spent() == Spent(1, 525, 10, (525 * 2.0 + 10 * 8.0) / 1e6)
    asking.ask(REQUEST)
    with pytest.raises(BudgetError, match="1,000"):
        asking.ask(REQUEST)


def test_question_without_a_reply_is_booked_once(ledger):
    """The flight ends before the reply. A later reply is not booked again."""
    free = threading.Event()

    class Slow(Fixed):
        def ask(self, request):
            if self.asked:
                free.wait()
            return super().ask(request)

    asking = BudgetedModel(Slow(Reply("y" * 40, 1.0)), PRICED, Budget(), ledger)
    asking.ask(REQUEST)
    open_question = DaemonExecutor().submit(asking.ask, REQUEST)
    while not asking._open:
        pass
    asking.book_open()
    two = Spent(2, 2 * 525, 2 * 10, 2 * (525 * 2.0 + 10 * 8.0) / 1e6)
    assert ledger.spent() == two
    free.set()
    assert open_question.result().text
    assert ledger.spent() == two


def test_failed_question_is_not_booked_as_open(ledger):
    class Dead(Fixed):
        def ask(self, request):
            raise ModelError("nothing answers")

    asking = BudgetedModel(Dead(None), PRICED, Budget(), ledger)
    with pytest.raises(ModelError):
        asking.ask(REQUEST)
    asking.book_open()
    assert ledger.spent() == Spent()


def test_unenforceable_limits_are_rejected_before_a_flight():
    for accounts, fields, *words in (
        ({"cost_limit_usd": 1.0}, {"model": ModelSpec(provider="local", name="m", base_url="http://h/v1")},
         "--cost-limit", "local/m"),
        ({"cost_limit_usd": 0.0}, {"model": PRICED}, "--cost-limit", "'0.0'"),
        ({"cost_limit_usd": float("nan")}, {"model": PRICED}, "--cost-limit", "'nan'"),
        ({"token_limit": 0}, {"model": PRICED}, "--token-limit", "'0'"),
        ({"token_limit": 5}, {"pilot": "vision"}, "--token-limit", "--model"),
        ({"cache": "replies"}, {"pilot": "vision"}, "--cache", "--model"),
        ({"cache": "/proc/version"}, {"model": PRICED}, "/proc/version", "cache"),
        ({"ledger": "/proc/version"}, {"model": PRICED}, "/proc/version", "ledger"),
        ({"cost_limit_usd": 1.0}, {"model": PRICED, "command": "hierarchical", "commander": UNPRICED},
         "--cost-limit", "local/c"),
        ({"cost_limit_usd": 1.0}, {"pilot": "oracle", "command": "hierarchical", "commander": UNPRICED},
         "--cost-limit", "local/c"),
    ):  # fmt: skip

        def flight(accounts=accounts, fields=fields):
            options = {"accounts": Accounts(**accounts), **fields}
            return look_up(FlightSpec(episode="residential-approaching-01", simulated=Simulated(), **options))

        message = refusal(flight)
        assert [word for word in words if word not in message] == [], message


def _counted(content, status=200, **choice):
    usage = {"prompt_tokens": 1000, "completion_tokens": 50}
    return say(answer(status, {"choices": [{"message": {"content": content}, **choice}], "usage": usage}))


ONCE, TWICE, THRICE = (Spent(0, n * 1000, n * 50, n * 0.0024) for n in (1, 2, 3))


@pytest.mark.parametrize(
    ("script", "lost", "replied"),
    [
        ([_counted(17)], ONCE, False),
        ([_counted("x", 500)], THRICE, False),
        ([_counted("x", 401)], ONCE, False),
        ([_counted("x", error={"code": 502}), _counted("x", 503), _counted("good")], TWICE, True),
        ([say(answer(500, {"error": "busy"})), say(answer(200, b"<html>"))], Spent(), False),
    ],
    ids=["unreadable", "always 500", "rejected", "two retries", "not counted"],
)
def test_tokens_of_answers_without_a_reply_are_booked(ledger, script, lost, replied):
    wire = Wire(*script)
    spec = replace(PRICED, base_url=wire.url)
    served = open_model(spec, RetryPolicy(give_up_s=5.0, attempts=3, pause_s=0.0))
    asking = BudgetedModel(served, spec, Budget(cost_usd=0.5), ledger)
    try:
        with nullcontext() if replied else pytest.raises(ModelError):
            asking.ask(REQUEST)
    finally:
        served.close()
        wire.close()
    spent, reply = ledger.spent(), ONCE if replied else Spent()
    assert spent.questions == int(replied)
    assert (spent.tokens_in, spent.tokens_out) == (lost.tokens_in + reply.tokens_in, lost.tokens_out + reply.tokens_out)
    assert spent.usd == pytest.approx(lost.usd + reply.usd)
