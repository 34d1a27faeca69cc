"""One run on this machine, without a benchmark around it: an audit, a measurement."""

from collections.abc import Callable, Sequence

from dronecats.bench.batch import Batch
from dronecats.bench.campaign import Came, Campaign, OpenRun
from dronecats.bench.local import LocalEngine
from dronecats.bench.matrix import BenchEntry
from dronecats.flight.spec.flight_spec import FlightSpec
from foundation.run_folder.results import Result


def fly_run(
    batch: Batch,
    flight: FlightSpec,
    episodes: Sequence[str],
    jobs: int,
    on_came: Callable[[Came], None] = lambda came: None,
) -> list[Result]:
    """Fly what is left of some episodes, once each, and return the results in the order in which they ended.

    `flight`: each of them, but for its episode. Raises as `Campaign.fly`.
    """
    came: list[Came] = []

    def take(each: Came) -> None:
        came.append(each)
        on_came(each)

    entry = BenchEntry(name=batch.run.name, flight=flight, episodes=tuple(episodes))
    campaign = Campaign([OpenRun(entry=entry, batch=batch, part=entry.episodes)], jobs=jobs, retry=False)
    if campaign.left:
        campaign.fly(LocalEngine(batch.run / "worker.log", min(jobs, len(campaign.left))), take)
    return [each.result for each in came]
