"""A run that has spent its budget resumes under a higher one. Earlier costs count."""

from dataclasses import replace

import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.ledger import Ledger
from dronecats.agent.models.spec import ModelSpec
from dronecats.bench.campaign import Batch, Campaign, EndedFlight, OpenRun
from dronecats.bench.engine import LocalEngine
from dronecats.bench.matrix import BenchEntry
from dronecats.flight.run.fly import settings
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import Accounts, FlightSpec, Simulated
from dronecats.pilots import roster
from dronecats.pilots.server import PilotServer
from foundation.run_folder.layout import LEDGER

EASY = "residential-approaching-01"


@pytest.mark.slow
def test_an_episode_over_budget_is_flown_again_under_a_higher_limit(tmp_path):
    server = PilotServer(roster.answer("vision"), "vision").start()
    model = ModelSpec(provider="local", name="vision", base_url=server.base_url)
    spec = FlightSpec(
        model=model,
        simulated=Simulated(speed=None),
        seed=3,
        latency=LatencyPolicy.parse("fixed:0.5"),
        accounts=Accounts(token_limit=2000),
    )

    def fly_spec(flight_spec):
        flight = look_up(flight_spec)
        batch = Batch(tmp_path / "run", settings(flight, flight.camera))
        try:
            came: list[EndedFlight] = []
            run = OpenRun(entry=BenchEntry(name="run", flight=flight_spec, episodes=(EASY,)), batch=batch, part=(EASY,))
            ending = Campaign([run], jobs=1).fly(LocalEngine(tmp_path / "worker.log", 1), came.append)
            return ending, [one.result for one in came], batch.left([EASY])
        finally:
            batch.close()

    ending, (spent,), left = fly_spec(spec)
    assert ending == "budget"
    assert (spent.outcome, spent.reason, left) == ("error", "budget", [EASY])
    assert spent.error is not None
    assert "2,000 tokens" in spent.error
    ending, (again,), left = fly_spec(replace(spec, accounts=Accounts(token_limit=10**6)))
    assert (ending, again.outcome, left) == ("flown", "success", [])
    ledger = Ledger(tmp_path / "run" / LEDGER)
    assert ledger.spent().questions == spent.steps + again.steps
    ledger.close()
    server.close()
