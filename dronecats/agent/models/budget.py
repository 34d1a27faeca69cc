"""A model that may cost so much and no more: looked at before each question, booked after each reply."""

import math
from dataclasses import dataclass

from dronecats.agent.models.http_model import tokens_of
from dronecats.agent.models.ledger import Books, Spent
from dronecats.agent.models.model import Model, Reply, Request
from dronecats.agent.models.spec import ModelSpec
from foundation.errors import BudgetError, UsageError

MILLION = 1e6
CHARACTERS_PER_TOKEN = 4  # of a reply whose tokens nobody tells


@dataclass(frozen=True, slots=True)
class Budget:
    """What a run may spend, all that its ledger holds included. None: no limit."""

    cost_usd: float | None = None
    tokens: int | None = None

    def check(self, spent: Spent) -> None:
        """Raise BudgetError when it is spent."""
        far = f"{told(spent)}, {spent.questions:,} questions"
        if self.cost_usd is not None and spent.usd >= self.cost_usd:
            raise BudgetError(f"the cost limit of ${self.cost_usd:g} is spent ({far}); raise --cost-limit to fly on")
        if self.tokens is not None and spent.tokens >= self.tokens:
            raise BudgetError(f"the limit of {self.tokens:,} tokens is spent ({far}); raise --token-limit to fly on")

    def check_prices(self, spec: ModelSpec) -> None:
        """Raise UsageError for a limit that nobody can hold a model to."""
        if self.cost_usd is not None and (spec.input_usd is None or spec.output_usd is None):
            said = f"--cost-limit cannot hold {spec.title}, whose prices are not known"
            raise UsageError(f"{said}: declare input_usd and output_usd for it, or give a --token-limit")


def cost_limit(said: str | float) -> float:
    """Return the $ that a limit says. Raises UsageError for what is none."""
    try:
        usd = float(said)
    except ValueError:
        usd = math.nan
    if not 0.0 < usd < math.inf:
        raise UsageError(f"--cost-limit wants a number of $ above 0, got {_short(said)}; without a limit, leave it out")
    return usd


def token_limit(said: str | int) -> int:
    """Return the tokens that a limit says. Raises UsageError for what is none."""
    try:
        tokens = int(said)
    except ValueError:
        tokens = 0
    if tokens < 1:
        asked = "a whole number of tokens, 1 or more"
        raise UsageError(f"--token-limit wants {asked}, got {_short(said)}; without a limit, leave it out")
    return tokens


def _short(said: object) -> str:
    return f"'{str(said)[:40]}'"


def told(spent: Spent) -> str:
    """Return what has been spent in a few words."""
    return f"{spent.tokens:,} tokens" + (f", ${spent.usd:.4f}" if spent.usd else "")


def cost(spec: ModelSpec, tokens_in: int, tokens_out: int) -> float:
    """Return the $ of a question and its reply, as far as prices are known."""
    return (tokens_in * (spec.input_usd or 0.0) + tokens_out * (spec.output_usd or 0.0)) / MILLION


def spent_on(spec: ModelSpec, request: Request, reply: Reply) -> Spent:
    """Return what a question and its reply have cost. Tokens that an endpoint does not count are estimated."""
    tokens_in = tokens_of(request) if reply.tokens_in is None else reply.tokens_in
    tokens_out = len(reply.text) // CHARACTERS_PER_TOKEN if reply.tokens_out is None else reply.tokens_out
    return Spent(1, tokens_in, tokens_out, cost(spec, tokens_in, tokens_out))


class BudgetedModel:
    """Asks a model while there is something left. Questions under way together may overshoot by one each."""

    def __init__(self, model: Model, spec: ModelSpec, budget: Budget, ledger: Books) -> None:
        self.name = model.name
        self._model, self._spec, self._budget, self._ledger = model, spec, budget, ledger

    def ask(self, request: Request) -> Reply:
        """Return the reply, with what it costs in the ledger. Raises BudgetError, ModelError, InfrastructureError."""
        self._budget.check(self._ledger.spent())
        reply = self._model.ask(request)
        self._ledger.spend(self._spec.title, spent_on(self._spec, request, reply))
        return reply

    def check(self) -> None:
        self._model.check()

    def close(self) -> None:
        self._model.close()
