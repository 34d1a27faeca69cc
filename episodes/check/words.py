"""The instruction: it must name the target as a person would, and nothing else."""

import re
from collections.abc import Iterator

from episodes import assets
from episodes.check.finding import Finding
from episodes.record import EpisodeRecord
from episodes.world import World

# What people call the assets; any other is called by its name.
NOUNS: dict[str, tuple[str, ...]] = {
    "suv": ("SUV",),
    "sedan": ("sedan", "saloon"),
    "hatchback": ("hatchback",),
    "pickup": ("pickup truck", "pickup"),
    "van": ("van",),
    "bus": ("bus",),
    "motorcycle": ("motorcycle", "motorbike"),
    "cyclist": ("cyclist", "bicycle"),
    "person": ("person", "pedestrian"),
    "quadrotor": ("quadrotor", "drone on the stand"),
}


def nouns(asset: str) -> tuple[str, ...]:
    """Return what people call an asset or a kind of fixture, the commonest word first."""
    return NOUNS.get(asset, (asset.replace("-", " ").replace("_", " "),))


def says(text: str, words: str) -> bool:
    """Return whether an instruction contains words, whole and in whatever case."""
    return re.search(rf"(?<![\w-]){re.escape(words)}(?![\w-])", text, re.IGNORECASE) is not None


def rules(world: World) -> Iterator[Finding]:
    """Yield the findings about the instruction."""
    record = world.record
    kinds = nouns(record.target.asset)
    if record.cell == "commanding":
        yield from inscription(record)
        return
    named = any(says(record.instruction, word) for word in kinds)
    yield Finding("the instruction's noun", named, f"'{record.instruction}'", " or ".join(f"'{k}'" for k in kinds))
    if record.target.native is None and record.map == "residential":
        yield from paint(world)


def inscription(record: EpisodeRecord) -> Iterator[Finding]:
    """Yield whether the instruction of a commanding record tells its inscription and no look-alike's."""
    text = record.target.inscription or ""
    named = bool(text) and says(record.instruction, text)
    yield Finding("the instruction's inscription", named, f"'{record.instruction}'", f"'{text}'")
    others = [c.inscription for c in record.candidates if c.inscription and says(record.instruction, c.inscription)]
    yield Finding("other inscriptions in the instruction", not others, ", ".join(others) or "none", "none")


def paint(world: World) -> Iterator[Finding]:
    """Yield whether the paint is named, no other one is, and it is worn by no other vehicle."""
    record = world.record
    told = [name for name in assets.PAINTS if says(record.instruction, name)]
    yield Finding(
        "the instruction's colour", told == [record.target.paint], ", ".join(told) or "none", str(record.target.paint)
    )
    others = [
        i.name
        for i in world.scene.instances
        if i is not world.target
        and i.kind in assets.names()
        and any(m.name == f"paint-{record.target.paint}" for m in i.mesh.materials)
    ]
    alone = Finding("others in the target's colour", not others, ", ".join(others[:3]) or "none", "none")
    yield alone
