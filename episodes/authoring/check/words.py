"""The instruction: it must name the target as a person would, and nothing else."""

import re
from collections.abc import Iterator

from episodes.authoring.check import referring
from episodes.authoring.check.finding import RuleFinding
from episodes.authoring.check.referring import kind_of, nouns
from episodes.maps import assets
from episodes.records.record import EpisodeRecord
from episodes.world.world import World


def says(text: str, words: str) -> bool:
    """Return whether an instruction contains words, whole and in whatever case."""
    return re.search(rf"(?<![\w-]){re.escape(words)}(?![\w-])", text, re.IGNORECASE) is not None


def rules(world: World) -> Iterator[RuleFinding]:
    """Yield the findings about the instruction."""
    record = world.record
    kinds = nouns(record.target.asset)
    if record.cell == "commanding":
        yield from inscription(record)
        return
    named = any(says(record.instruction, word) for word in kinds)
    yield RuleFinding("the instruction's noun", named, f"'{record.instruction}'", " or ".join(f"'{k}'" for k in kinds))
    if record.map == "residential" and record.target.native is None:
        yield from paint(world)
    elif named and referring.places(record.map, record.map_seed).landmarks:
        yield place(world)


def inscription(record: EpisodeRecord) -> Iterator[RuleFinding]:
    """Yield whether the instruction of a commanding record tells its inscription and no look-alike's."""
    text = record.target.inscription or ""
    named = bool(text) and says(record.instruction, text)
    yield RuleFinding("the instruction's inscription", named, f"'{record.instruction}'", f"'{text}'")
    others = [c.inscription for c in record.candidates if c.inscription and says(record.instruction, c.inscription)]
    yield RuleFinding("other inscriptions in the instruction", not others, ", ".join(others) or "none", "none")


def paint(world: World) -> Iterator[RuleFinding]:
    """Yield whether the paint is named, no other one is, and it is worn by no other vehicle."""
    record = world.record
    told = [name for name in assets.PAINTS if says(record.instruction, name)]
    yield RuleFinding(
        "the instruction's colour", told == [record.target.paint], ", ".join(told) or "none", str(record.target.paint)
    )
    others = [
        i.name
        for i in world.scene.instances
        if i is not world.target
        and i.kind in assets.names()
        and any(m.name == f"paint-{record.target.paint}" for m in i.mesh.materials)
    ]
    alone = RuleFinding("others in the target's colour", not others, ", ".join(others[:3]) or "none", "none")
    yield alone


def place(world: World) -> RuleFinding:
    """Return whether the instruction tells the target from its near-duplicates by where it stands."""
    record = world.record
    kind = kind_of(record.target.asset)
    things = {i.name: i.position_ned for i in world.scene.instances if kind_of(i.kind) == kind}
    viewer = record.starts[0].position_ned
    yaw = record.starts[0].yaw_deg if record.visible_at_start else None
    marks = referring.landmarks(record.map, record.map_seed, kind, viewer, yaw)
    told = referring.read(record.instruction, marks)
    rule, wanted = "what the instruction's place tells", f"{world.target.name} alone"
    if told is None:
        alone = list(things) == [world.target.name]
        hint = "nearest, left of, right of, in front of, behind or between landmarks"
        return RuleFinding(rule, alone, f"none of {len(things)}", f"{wanted}, by {hint}")
    clear, loose = referring.denotes(told, things, marks, viewer)
    fine = clear == loose == [world.target.name]
    return RuleFinding(rule, fine, ", ".join(dict.fromkeys([*clear, *loose])) or "nothing", wanted)
