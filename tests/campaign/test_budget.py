"""A run whose budget is spent is gone on with under a greater one, and what it has cost before counts."""

from dataclasses import replace

import pytest

from dronecats.agent.models.ledger import Ledger
from dronecats.agent.models.spec import ModelSpec
from dronecats.campaign.batch import Batch
from dronecats.campaign.runner import Runner
from dronecats.flight.flight import look_up
from dronecats.flight.spec import Accounts, FlightSpec, Simulated
from dronecats.pilots import roster
from dronecats.pilots.server import PilotServer
from dronecats.run.settings import settings
from dronecats.rundir.layout import LEDGER

EASY = "residential-approaching-01"


@pytest.mark.slow
def test_an_episode_that_cost_too_much_is_flown_again_under_a_greater_limit(tmp_path):
    server = PilotServer(roster.answer("vision"), "vision").start()
    model = ModelSpec(provider="local", name="vision", base_url=server.base_url)
    spec = FlightSpec(
        model=model, simulated=Simulated(speed=None), seed=3, latency="fixed:0.5", accounts=Accounts(token_limit=2000)
    )

    def flown(each):
        flight = look_up(each)
        batch = Batch(tmp_path / "run", settings(flight, flight.camera))
        try:
            return Runner(batch, each, 1).fly(batch.left([EASY])), batch.left([EASY])
        finally:
            batch.close()

    (spent,), left = flown(spec)
    assert (spent.outcome, spent.reason, left) == ("error", "budget", [EASY])
    assert spent.error is not None
    assert "the limit of 2,000 tokens is spent" in spent.error
    (again,), left = flown(replace(spec, accounts=Accounts(token_limit=10**6)))
    assert (again.outcome, left) == ("success", [])
    ledger = Ledger(tmp_path / "run" / LEDGER)
    assert ledger.spent().questions == spent.steps + again.steps
    ledger.close()
    server.close()
