"""All rules on one record."""

from collections.abc import Iterable
from dataclasses import replace

from episodes.authoring.check import candidates, footing, sight, start, words
from episodes.authoring.check.finding import RuleFinding
from episodes.authoring.check.solid import StandingObstacles
from episodes.world.world import World


def check(world: World) -> list[RuleFinding]:
    """Return every rule's finding about a world's record, in a fixed order."""
    standing = StandingObstacles(world.scene.instances)
    place = "target.position_ned" if world.record.target.path is None else "target.path"
    return [
        *_about("starts", start.rules(world, standing)),
        *_about("starts", sight.rules(world)),
        *_about(place, footing.rules(world, standing)),
        *_about("candidates", candidates.rules(world, standing)),
        *_about("instruction", words.rules(world)),
    ]


def _about(field: str, findings: Iterable[RuleFinding]) -> list[RuleFinding]:
    """Return findings with the field they are about, where they do not name it themselves."""
    return [found if found.field else replace(found, field=field) for found in findings]
