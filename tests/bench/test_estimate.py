"""The cost of a benchmark is estimated first, then derived from the flights that have ended."""

import json
from dataclasses import replace

import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.ledger import Spent
from dronecats.agent.models.spec import ModelSpec
from dronecats.bench.campaign import Batch, OpenRun
from dronecats.bench.matrix import BenchEntry
from dronecats.bench.progress import CostEstimate, Progress, foreseen_usd
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from foundation.run_folder.results import Result
from foundation.run_folder.rows import Exchange
from foundation.run_folder.writing import as_json
from tests.judge.episode_logs import decision

IDS = ("residential-approaching-01", "residential-approaching-02", "campus-tracking-01", "campus-tracking-02")
PRICED = ModelSpec(provider="local", name="m", base_url="http://h/v1", input_usd=1.0, output_usd=10.0)
FLIGHT = FlightSpec(model=PRICED, simulated=Simulated(speed=None))


@pytest.fixture
def run(tmp_path):
    batch = Batch(tmp_path / "run-f1", {"agent": "x"})
    yield OpenRun(entry=BenchEntry(name="run-f1", flight=FLIGHT, episodes=IDS), batch=batch, part=IDS)
    batch.close()


def ended(run, episode, outcome, tokens):
    """Write the log of a flight of two steps with `tokens` input tokens each, and return its result."""
    folder = run.batch.run / episode
    folder.mkdir(parents=True)
    decisions = [decision(k, k, 2.0 * k, tokens_in=tokens, tokens_out=tokens // 10) for k in range(2)]
    (folder / "decisions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in decisions))
    return Result(episode=episode, outcome=outcome)


def test_each_remaining_flight_is_estimated_at_the_median_cost_of_failed_flights(run):
    estimate = CostEstimate([run], [("run-f1", episode) for episode in IDS])
    before = estimate.left_usd()
    assert before == pytest.approx(sum(foreseen_usd(FLIGHT, run.batch.record(episode)) for episode in IDS))
    estimate.add(run, ended(run, IDS[0], "success", 1000))
    assert estimate.flights == 3  # as long as no flight has failed, the successful ones count
    assert estimate.left_usd() == pytest.approx(3 * 0.004)
    estimate.add(run, ended(run, IDS[1], "failure", 5000))
    assert estimate.flights == 2
    assert estimate.left_usd() == pytest.approx(2 * 0.020)
    estimate.add(run, ended(run, IDS[2], "error", 9000))
    assert estimate.flights == 1
    assert estimate.left_usd() == pytest.approx(0.020)


def test_a_flight_to_be_retried_counts_as_remaining(run):
    estimate = CostEstimate([run], [("run-f1", IDS[0])])
    estimate.add(run, ended(run, IDS[0], "failure", 1000), again=True)
    assert estimate.flights == 1
    assert estimate.left_usd() == pytest.approx(0.004)


def test_the_estimate_depends_on_drones_latency_and_price(run):
    record = run.batch.record(IDS[0])
    four = {**record, "starts": record["starts"] * 4}
    one = foreseen_usd(FLIGHT, record)
    assert one > 0.0
    assert foreseen_usd(replace(FLIGHT, command="solo"), four) == pytest.approx(4 * one)
    assert one < foreseen_usd(FLIGHT, four) < 4 * one  # one question with four pictures
    assert foreseen_usd(replace(FLIGHT, latency=LatencyPolicy.parse("fixed:3")), record) < one
    capped = foreseen_usd(replace(FLIGHT, latency=LatencyPolicy.parse("fixed:0.5+cap:0.1")), record)
    assert capped < one / 2  # at most one question per 10 s
    unpriced = replace(run, entry=replace(run.entry, flight=replace(FLIGHT, model=replace(PRICED, input_usd=None))))
    estimate = CostEstimate([unpriced], [("run-f1", IDS[0])])
    assert (estimate.left_usd(), estimate.unpriced) == (None, "local/m")
    pilot = replace(run, entry=replace(run.entry, flight=FlightSpec(pilot="vision", simulated=Simulated())))
    assert CostEstimate([pilot], [("run-f1", IDS[0])]).flights == 0


def test_the_estimate_includes_the_commander(run):
    record = run.batch.record(IDS[0])
    fleet = {**record, "starts": record["starts"] * 4}
    below = replace(FLIGHT, command="hierarchical")
    commanded = FlightSpec(pilot="vision", command="hierarchical", commander=PRICED, simulated=Simulated(speed=None))
    alone = foreseen_usd(replace(below, scripted="scripted"), fleet)
    assert foreseen_usd(commanded, fleet) > 0.0
    assert foreseen_usd(below, fleet) == pytest.approx(alone + foreseen_usd(commanded, fleet))
    run = replace(run, entry=replace(run.entry, flight=commanded))
    estimate = CostEstimate([run], [("run-f1", episode) for episode in IDS])
    assert estimate.flights == len(IDS)
    result = ended(run, IDS[0], "failure", 0)
    exchange = Exchange(
        number=0, t_asked=0.0, t_answered=1.0, causes=(), roster="", frames=(0,), reply="{}", orders=(), confirms=(),
        tokens_in=1000, tokens_out=100, model="m",
    )  # fmt: skip
    (run.batch.run / IDS[0] / "commander.jsonl").write_text(json.dumps(as_json(exchange)) + "\n")
    estimate.add(run, result)
    assert estimate.left_usd() == pytest.approx(3 * 0.002)


def test_the_progress_line_shows_the_estimated_total_cost():
    line = Progress(total=8).line(1.0, Spent(3, 1000, 234, 1.5), left_usd=2.25)
    assert "$1.50 of about $3.75" in line
    assert "about" not in Progress(total=8).line(1.0, Spent(3, 1000, 234, 1.5), left_usd=None)
