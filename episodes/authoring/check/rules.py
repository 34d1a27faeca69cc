"""All rules on one record, and on many at once, each in a process of a small pool."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from episodes.authoring.check import candidates, placement, sight, words
from episodes.authoring.check.finding import RuleFinding
from episodes.authoring.check.placement import StandingObstacles
from episodes.authoring.check.spread import Layout, layout
from episodes.authoring.processes import share_out
from episodes.records import catalogue
from episodes.world.world import World
from foundation.errors import UsageError


def check(world: World) -> list[RuleFinding]:
    """Return every rule's finding about a world's record, in a fixed order."""
    standing = StandingObstacles(world.scene.instances)
    place = "target.position_ned" if world.record.target.path is None else "target.path"
    return [
        *_about("starts", placement.start_rules(world, standing)),
        *_about("starts", sight.rules(world)),
        *_about(place, placement.target_rules(world, standing)),
        *_about("candidates", candidates.rules(world, standing)),
        *_about("instruction", words.rules(world)),
    ]


def _about(field: str, findings: Iterable[RuleFinding]) -> list[RuleFinding]:
    """Return findings with the field they are about, where they do not name it themselves."""
    return [found if found.field else replace(found, field=field) for found in findings]


@dataclass(frozen=True, slots=True)
class Report:
    """What the rules say about one record."""

    name: str  # its id; where it cannot be read, what it was asked for by
    asked: str  # id, file or folder
    findings: tuple[RuleFinding, ...] = ()
    refused: str | None = None  # why it could not be read or built at all
    layout: Layout | None = None  # for the rules about a suite

    @property
    def reason(self) -> str | None:
        """Return why the record is rejected, in one line with file, field and reason; None when it is accepted."""
        if self.refused:
            return self.refused
        failed = "; ".join(f.sentence for f in self.findings if not f.passed)
        return f"{self.asked}: {failed}." if failed else None


def check_one(asked: str, laid_out: bool = False) -> Report:
    """Return the report on a record given by its id, its file or its folder, its layout with it where asked for."""
    name = asked
    try:
        record = catalogue.load(asked)
        name = record.id
        world = World(record)
        return Report(name, asked, tuple(check(world)), layout=layout(world) if laid_out else None)
    except UsageError as error:
        return Report(name, asked, refused=str(error))


def check_all(asked: Sequence[str], jobs: int | None = None, laid_out: bool = False) -> Iterator[Report]:
    """Yield the reports as they are done, on `jobs` processes (default: one per core)."""
    yield from share_out(partial(check_one, laid_out=laid_out), asked, jobs)
