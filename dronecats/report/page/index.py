"""Writes the page of a report: index.html, and the files of flights and pictures that index.html loads on demand."""

import html
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats import __version__
from dronecats.judge.metrics.judging import METRICS
from dronecats.judge.metrics.metric import MetricValue
from dronecats.report.kit import shell
from dronecats.report.kit.shell import OUTCOMES
from dronecats.report.page.flights import PageObject, fields, shown_flight
from dronecats.report.page.pictures import (
    FOLDER,
    PictureAddress,
    embedded_pictures,
    embedding_stride,
    ground_key,
    grounds,
    linked_pictures,
    no_pictures,
)
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.report_data import entrants
from dronecats.report.results.collection import Collection, ScoredEpisode
from dronecats.report.table import ReportTable, TableColumn, TableRow
from dronecats.report.writers import as_html
from episodes.records.record import CELLS
from foundation.errors import InfrastructureError, UsageError
from foundation.files import file_errors_as, whole_file

RESERVED = ("of",)  # first words of page addresses (#of/ENTRANT); no run may have them as its key
# fields of run.json's `flight` that the page shows
SETTING_KEYS = ("command", "scripted", "latency", "rate_hz", "parser", "drones", "seed", "seconds", "full")


def keys(names: Sequence[str]) -> list[str]:
    """Return a unique key for each name. The keys are valid in file names and addresses."""
    taken: set[str] = set(RESERVED)
    result = []
    for name in names:
        word = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip(".-") or "run"
        key, count = word, 2
        while key.lower() in taken:
            key, count = f"{word}-{count}", count + 1
        taken.add(key.lower())
        result.append(key)
    return result


def _page_runs(collection: Collection) -> tuple[list[PageObject], list[PageObject]]:
    """Return the run folders in the order of the collection, and their entrants in the order of the tables.

    An entrant is a row of the tables: all runs that differ only in the seed. Raises UsageError if two records have the
    same id.
    """
    places = {run.folder: number for number, run in enumerate(collection.runs)}
    found_entrants = entrants(collection, pool_anyway=True)
    number_of = {run.folder: number for number, entrant in enumerate(found_entrants) for run in entrant.runs}
    run_keys = keys([run.folder.name for run in collection.runs])
    runs = [
        {
            "key": key,
            "entrant": number_of[run.folder],
            "seed": run.seed,
            "rendered": run.is_rendered,  # True: rendered frames; False: grey frames
            "settings": _settings(run),
        }
        for key, run in zip(run_keys, collection.runs, strict=True)
    ]
    page_entrants = [
        {
            "key": key,
            "title": entrant.label,
            "model": entrant.is_model,  # whether a model flew; False for built-in pilots and replays
            "runs": [places[run.folder] for run in entrant.runs],
        }
        for key, entrant in zip(keys([entrant.label for entrant in found_entrants]), found_entrants, strict=True)
    ]
    return runs, page_entrants


def _page_episode(
    scored: ScoredEpisode,
    metrics: Sequence[PageObject],
    key: str,
    run: int,
    ground: str,
    error: str | None,
    shown: bool,
) -> PageObject:
    """Return the data of one flight of one episode for the index."""
    verdict = scored.verdict
    return fields(
        key=key,
        run=run,
        id=scored.episode,
        map=scored.map,
        cell=scored.cell,
        outcome="damaged" if verdict is None else verdict.outcome,
        mode=scored.mode,  # success or the failure mode; missing: not scored
        counted=scored.scored,  # scored, and not excluded from the report
        error=error,
        steps=None if verdict is None else verdict.steps,
        declarations=None if verdict is None else verdict.declarations,
        ground=ground,  # key of the picture of the map; empty: no picture
        shown=shown,  # whether the page has the steps of the flight
        values=[_seen(scored.values.get(metric["name"])) for metric in metrics],
    )


def script_json(value: Any) -> str:
    """Return a value as JSON for a script element or file. No text in the value can end the element."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _page_metrics(collection: Collection) -> list[PageObject]:
    """Return the metrics of episodes: those of the registry, then the user's own metrics (only names)."""
    ours = [metric for metric in METRICS.values() if metric.level == "episode"]
    own = {name for scored in collection.episodes for name in scored.values} - {*METRICS}
    return [
        *({"name": m.name, "title": m.title, "unit": m.unit, "definition": m.definition} for m in ours),
        *({"name": name, "title": name, "unit": "", "definition": "a metric of the user"} for name in sorted(own)),
    ]


def _seen(value: MetricValue | None) -> MetricValue:
    """Return a value with five significant digits; None: unknown or not finite."""
    if value is None or isinstance(value, bool):
        return value
    return float(f"{value:.5g}") if math.isfinite(value) else None


def _settings(run: RecordedRun) -> tuple[tuple[str, str], ...]:
    flight, simulated = run.flight, run.flight.get("simulated")
    model, commander = flight.get("model"), flight.get("commander")
    settings = {key: flight.get(key) for key in SETTING_KEYS}
    if isinstance(simulated, dict):
        settings.update({key: simulated.get(key) for key in ("airframe", "autopilot")})
    if isinstance(model, dict):
        settings.update({key: model.get(key) for key in ("temperature", "top_p", "max_tokens", "axis_order")})
    if isinstance(commander, dict):
        settings["commander"] = f"{commander.get('provider')}/{commander.get('name')}"
    settings.update(
        {
            key: run.configuration.get(key)
            for key in ("clock", "disturbed", "served_rate_hz", "prompt_name", "prompt_sha256")
        }
    )
    return tuple((key, str(value)) for key, value in settings.items() if value is not None and value != "")


PAGE = "index.html"
DATA = "data"  # folder with a script per flight; not JSON, because a page on a local disk can load only scripts
CALL = "dronecatsFlight("  # the beginning of a flight's script
TITLE = "DroneCATS report"
KEYS_BUTTON = '<button type="button" id="keys" class="tool" aria-haspopup="dialog" title="Keyboard (?)">Keys</button>'
MORE = """<noscript><p>This page needs JavaScript. It loads nothing from the network.</p></noscript>
<dialog id="help" aria-labelledby="help-title"></dialog>
<p id="said" class="unseen" role="status" aria-live="polite"></p>
<template id="tables">{tables}</template>
<script type="application/json" id="index">{index}</script>"""


def write_page(collection: Collection, tables: Sequence[ReportTable], out: Path, *, embed: bool = False) -> Path:
    """Write the page of a collection into the folder `out`, and return its path, out/index.html.

    Flights and pictures are in the folders data/ and pictures/ in `out`. `embed` puts flights and pictures into the
    page itself. Embedded pictures are smaller. If a browser could not open a page with all of them, the page keeps only
    those of every n-th step, the last step and the declarations. Raises UsageError if the page cannot be written.
    """
    with file_errors_as(UsageError, f"the report cannot be written to {out}"):
        return _write(collection, tables, out, embed)


def remove_page(out: Path) -> None:
    """Remove the page of an earlier report from the folder, if there is one. Raises InfrastructureError."""
    with file_errors_as(InfrastructureError, f"the page {out / PAGE} cannot be removed"):
        if (out / PAGE).exists():
            (out / PAGE).unlink()
            _remove_files(out)


def _remove_files(out: Path, kept: Iterable[Path] = ()) -> None:
    """Remove the flights of a page except those in `kept`, their pictures, and folders that this empties.

    Files of the user stay.
    """
    for data in {*out.glob(f"{DATA}/*/*.js")}.difference(kept):
        with data.open("rb") as file:
            if file.read(len(CALL)) != CALL.encode():
                continue
        data.unlink()
        pictures = out / FOLDER / data.parent.name / data.stem
        for picture in pictures.glob(f"{'[0-9]' * 6}*.jpg"):
            picture.unlink()
        for folder in (data.parent, data.parents[1], pictures, *pictures.parents[:2]):
            with suppress(OSError):  # it is not empty, or does not exist
                folder.rmdir()


def _write(collection: Collection, tables: Sequence[ReportTable], out: Path, embed: bool) -> Path:
    out.mkdir(parents=True, exist_ok=True)
    metrics = _page_metrics(collection)
    runs, entrants = _page_runs(collection)
    every = embedding_stride(collection.runs) if embed else 1
    had_page = (out / PAGE).exists()
    places = {run.folder: number for number, run in enumerate(collection.runs)}
    named = _named(collection)
    episodes, blocks, seen_grounds, written = [], {}, [], []
    for scored, name in zip(collection.episodes, named, strict=True):
        number = places[scored.run.folder]
        key = f"{runs[number]['key']}/{name}"
        data, damage = None, scored.error
        if scored.verdict is not None:
            try:
                data = _flight(scored, scored.verdict.delta_m, key, out, embed, every)
            except UsageError as error:  # a damaged log that does not affect the verdict
                damage = str(error)
        if data is not None and embed:
            blocks[key] = data
        elif data is not None:
            path = out / DATA / f"{key}.js"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{CALL}{script_json(key)},{data});\n", encoding="ascii")
            written.append(path)
        ground = ground_key(scored.folder) if data is not None else ""
        seen_grounds.append(ground)
        episodes.append(_page_episode(scored, metrics, name, number, ground, damage, data is not None))
    used_cells = {episode["cell"] for episode in episodes}
    thinned = f"The page keeps the picture of one step in {every}, and of every declaration."
    index = {  # the data that the page reads when a browser opens it
        "made": f"dronecats {__version__}",
        "cells": [*(cell for cell in CELLS if cell in used_cells), *sorted(used_cells - {*CELLS, ""})],
        "metrics": metrics,
        "entrants": entrants,
        "runs": runs,
        "episodes": episodes,
        "outcomes": OUTCOMES,  # outcome → mark and word
        "grounds": grounds(seen_grounds),
        "embedded": embed,
        "pictures": "" if every == 1 else thinned,
    }
    content = shell.PageContent(
        title=TITLE,
        folder=__package__ or "",
        entry="main",
        main='<p class="quiet">Opening …</p>',
        tools=KEYS_BUTTON,
        more=MORE.format(tables=_sections(tables, entrants), index=script_json(index)),
        loads_files=True,
    )
    page = out / PAGE
    with whole_file(page) as draft, draft.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(shell.page(content, {f"flight:{key}": block for key, block in blocks.items()}))
    if had_page:
        _remove_files(out, written)
    return page


def _sections(tables: Sequence[ReportTable], entrants: Sequence[PageObject]) -> str:
    """Return the tables as HTML, with links from the rows to the flights."""
    keys = {entrant["title"]: entrant["key"] for entrant in entrants}
    sections = []
    for table in tables:
        blocks = tuple(
            replace(block, rows=tuple(_linked(row, table.columns, keys) for row in block.rows))
            for block in table.blocks
        )
        heading = f"<h2>{html.escape(table.title)}</h2>"
        sections.append(f"<section>{heading}{as_html(replace(table, blocks=blocks))}</section>")
    commands = dict.fromkeys(table.command for table in tables if table.command)
    sections += [f"<pre>{html.escape(command)}</pre>" for command in commands]
    return "\n".join(sections)


def _linked(row: TableRow, columns: Sequence[TableColumn], keys: Mapping[str, str]) -> TableRow:
    """Return a row with links: the name leads to the entrant, a value for one kind of episode to the entrant's flights.

    A row without an entrant is unchanged.
    """
    key = keys.get(row.entrant)
    if key is None:
        return row
    return replace(row, cells=tuple(
        replace(cell, link="#of/" + "/".join(filter(None, (key, column.cell)))) if number == 0 or column.cell else cell
        for number, (cell, column) in enumerate(zip(row.cells, columns, strict=True))
    ))  # fmt: skip


def _named(collection: Collection) -> list[str]:
    """Return a key for each episode; keys are unique within a run."""
    names: dict[Path, list[str]] = {}
    for scored in collection.episodes:
        names.setdefault(scored.run.folder, []).append(scored.folder.resolve().name)
    coming = {run: iter(keys(folder_names)) for run, folder_names in names.items()}
    return [next(coming[scored.run.folder]) for scored in collection.episodes]


def _flight(scored: ScoredEpisode, delta_m: float, key: str, out: Path, embed: bool, every: int) -> str:
    """Return a flight as JSON, and store its pictures for the page. Raises UsageError for a damaged log."""
    flight = RecordedFlight.read(scored.folder, delta_m)
    if not scored.run.is_rendered:
        picture: PictureAddress = no_pictures
    elif embed:
        picture = embedded_pictures(flight, every)
    else:
        picture = linked_pictures(flight, out, Path(FOLDER, *key.split("/")))
    return script_json(shown_flight(flight, picture))
