"""What a model may cost: looked at before each question, counted where nobody else counts, said when it is over."""

import pytest

from dronecats.agent.models.budget import Budget, BudgetedModel, told
from dronecats.agent.models.ledger import Ledger, Spent
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.flight.flight import look_up
from dronecats.flight.spec import Accounts, FlightSpec, Simulated
from foundation.errors import BudgetError, UsageError

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
    with pytest.raises(BudgetError, match=r"limit of \$0\.5 is spent \(220,000 tokens, \$0\.5600, 2 questions\)"):
        asking.ask(REQUEST)
    assert model.asked == 2
    BudgetedModel(model, PRICED, Budget(cost_usd=0.6), ledger).ask(REQUEST)  # a greater one goes on


def test_tokens_that_an_endpoint_does_not_count_are_counted(ledger):
    asking = BudgetedModel(Fixed(Reply("y" * 40, 1.0)), PRICED, Budget(tokens=1000), ledger)
    asking.ask(REQUEST)
    assert ledger.spent() == Spent(1, 525, 10, (525 * 2.0 + 10 * 8.0) / 1e6)
    asking.ask(REQUEST)
    with pytest.raises(BudgetError, match="the limit of 1,000 tokens is spent"):
        asking.ask(REQUEST)


def test_what_is_spent_in_a_few_words():
    assert told(Spent(2, 12_000, 345, 0.0)) == "12,345 tokens"
    assert told(Spent(2, 12_000, 345, 0.0123)) == "12,345 tokens, $0.0123"


@pytest.mark.parametrize(
    ("accounts", "fields", "said"),
    [
        (Accounts(cost_limit_usd=1.0), {"model": ModelSpec(provider="local", name="m", base_url="http://h/v1")},
         "--cost-limit cannot hold local/m, whose prices are not known"),
        (Accounts(cost_limit_usd=0.0), {"model": PRICED}, "--cost-limit wants a number of \\$ above 0, got '0.0'"),
        (Accounts(cost_limit_usd=float("nan")), {"model": PRICED}, "--cost-limit wants a number"),
        (Accounts(token_limit=0), {"model": PRICED}, "--token-limit wants a whole number"),
        (Accounts(token_limit=5), {"pilot": "vision"}, "--token-limit goes with --model"),
        (Accounts(cache="replies"), {"pilot": "vision"}, "--cache goes with --model"),
        (Accounts(cache="/proc/version"), {"model": PRICED}, "no cache|cannot be opened"),
        (Accounts(ledger="/proc/version"), {"model": PRICED}, "no ledger|cannot be opened"),
        (Accounts(cost_limit_usd=1.0), {"model": PRICED, "command": "hierarchical", "commander": UNPRICED},
         "--cost-limit cannot hold local/c, whose prices are not known"),
        (Accounts(cost_limit_usd=1.0), {"pilot": "oracle", "command": "hierarchical", "commander": UNPRICED},
         "--cost-limit cannot hold local/c, whose prices are not known"),
    ],
)  # fmt: skip
def test_what_cannot_be_held_is_refused_before_anything_flies(accounts, fields, said):
    spec = FlightSpec(episode="residential-approaching-01", simulated=Simulated(), accounts=accounts, **fields)
    with pytest.raises(UsageError, match=said):
        look_up(spec, ask_model=False)
