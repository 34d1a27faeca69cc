"""Writes the page: index.html, and beside it what it loads only when somebody looks at it."""

import html
from collections.abc import Sequence
from pathlib import Path

from dronecats.report.page.assembly import page
from dronecats.report.page.flights import shown_flight
from dronecats.report.page.ground import ground_key, grounds
from dronecats.report.page.index import keys, page_episode, page_index, page_metrics, page_runs, script_json
from dronecats.report.page.pictures import FOLDER, PictureAddress, beside, every_for, kept, nowhere, rendered, within
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.report_table import ReportTable
from dronecats.report.results.collection import Collection, ScoredEpisode
from foundation.errors import UsageError
from foundation.whole_file import whole_file

PAGE = "index.html"
DATA = "data"  # folder of the flights, a script each: a page on a disk may load scripts, and nothing else
TITLE = "DroneCATS report"


def write_page(
    collection: Collection, tables: Sequence[ReportTable], out: Path, *, embed: bool = False, every: int = 1
) -> Path:
    """Write the page of a collection into the folder `out`, and return its path, out/index.html.

    Flights and pictures lie beside it, in data/ and pictures/; `embed` puts them into the page itself, the pictures
    smaller and no more than a browser can open at once. `every` n leaves out the pictures of all but each n-th step,
    the first, the last, and the declarations. Raises UsageError where it cannot be written.
    """
    try:
        return _write(collection, tables, out, embed, every)
    except OSError as error:
        raise UsageError(f"the report cannot be written to {out}: {error.strerror or error}") from None


def _write(collection: Collection, tables: Sequence[ReportTable], out: Path, embed: bool, every: int) -> Path:
    out.mkdir(parents=True, exist_ok=True)
    metrics = page_metrics(collection)
    runs, entrants = page_runs(collection)
    if embed:
        every = max(every, every_for(collection.runs))
    places = {run.folder: number for number, run in enumerate(collection.runs)}
    named = _named(collection)
    episodes, blocks, seen_grounds = [], {}, []
    for scored, name in zip(collection.episodes, named, strict=True):
        number = places[scored.run.folder]
        key = f"{runs[number].key}/{name}"
        data, damage = None, scored.error
        if scored.verdict is not None:
            try:
                data = _flight(scored, scored.verdict.delta_m, key, out, embed, every)
            except UsageError as found:  # in a log that no verdict goes by
                damage = str(found)
        if data is not None and embed:
            blocks[key] = data
        elif data is not None:
            path = out / DATA / f"{key}.js"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"dronecatsFlight({script_json(key)},{data});\n", encoding="ascii")
        ground = ground_key(scored.folder) if data is not None else ""
        seen_grounds.append(ground)
        episodes.append(page_episode(scored, metrics, name, number, ground, damage, data is not None))
    index = page_index(
        metrics,
        runs,
        entrants,
        episodes,
        tables,
        grounds(seen_grounds),
        embedded=embed,
        pictures="" if every == 1 else f"Of each {every} steps one picture is kept, and all of declarations.",
    )
    whole = out / PAGE
    with whole_file(whole) as draft, draft.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(page(html.escape(TITLE), script_json(index), blocks))
    return whole


def _named(collection: Collection) -> list[str]:
    """Return a key for each episode that no other of its run has."""
    names: dict[Path, list[str]] = {}
    for scored in collection.episodes:
        names.setdefault(scored.run.folder, []).append(scored.folder.resolve().name)
    coming = {run: iter(keys(each)) for run, each in names.items()}
    return [next(coming[scored.run.folder]) for scored in collection.episodes]


def _flight(scored: ScoredEpisode, delta_m: float, key: str, out: Path, embed: bool, every: int) -> str:
    """Return a flight as JSON, its pictures put where the page finds them. Raises UsageError for a damaged log."""
    flown = RecordedFlight.read(scored.folder, delta_m)
    wanted = kept(flown.logs.decisions, every)
    if not rendered(scored.run):
        picture: PictureAddress = nowhere
    elif embed:
        picture = within(scored.folder, wanted)
    else:
        picture = beside(out, Path(FOLDER, *key.split("/")), scored.folder, wanted)
    return script_json(shown_flight(scored.run, flown, picture))
