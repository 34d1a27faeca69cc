"""What a model may cost: looked at before each question, counted where nobody else counts, said when it is over."""

import pytest

from dronecats.agent.models.ledger import Budget, BudgetedModel, Ledger, Spent
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import Accounts, FlightSpec, Simulated
from foundation.errors import BudgetError
from tests.support.refusal import refusal

UNPRICED = ModelSpec(provider="local", name="c", base_url="http://h/v1")
PRICED = ModelSpec(provider="openai", name="m", base_url="http://127.0.0.1:1/v1", input_usd=2.0, output_usd=8.0)
REQUEST = Request("t" * 400, (b"jpeg",), thinking=False)


class Fixed:
    """Answers the same, always."""

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


def test_cost_is_tokens_by_their_prices_and_ends_with_the_question_that_reaches_the_limit(ledger):
    model = Fixed(Reply("x", 1.0, tokens_in=100_000, tokens_out=10_000))  # $0.20 and $0.08
    asking = BudgetedModel(model, PRICED, Budget(cost_usd=0.5), ledger)
    asking.ask(REQUEST)
    assert ledger.spent().usd == pytest.approx(0.28)
    asking.ask(REQUEST)
    with pytest.raises(BudgetError, match=r"0\.5.*220,000.*0\.5600.*\b2\b"):
        asking.ask(REQUEST)
    assert model.asked == 2
    BudgetedModel(model, PRICED, Budget(cost_usd=0.6), ledger).ask(REQUEST)  # a greater one goes on


def test_tokens_that_an_endpoint_does_not_count_are_counted(ledger):
    asking = BudgetedModel(Fixed(Reply("y" * 40, 1.0)), PRICED, Budget(tokens=1000), ledger)
    asking.ask(REQUEST)
    assert ledger.spent() == Spent(1, 525, 10, (525 * 2.0 + 10 * 8.0) / 1e6)
    asking.ask(REQUEST)
    with pytest.raises(BudgetError, match="1,000"):
        asking.ask(REQUEST)


def test_what_cannot_be_held_is_refused_before_anything_flies():
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
            given = {"accounts": Accounts(**accounts), **fields}
            return look_up(FlightSpec(episode="residential-approaching-01", simulated=Simulated(), **given))

        message = refusal(flight)
        assert [word for word in words if word not in message] == [], message
