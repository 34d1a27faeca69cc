"""Who flew how: what a reader must know to fly a line of the tables again."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from dronecats.agent.models.providers import PROVIDERS
from dronecats.report.blocks import Lineup
from dronecats.report.entries import NAME, count
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.entrants import Entrant
from dronecats.report.results.identity import DIGEST, NOT_TOLD, identity

WORDS = {  # column → what of the identity stands there
    "served": ("As served", "the model as served"),
    "prompt": ("Prompt", "the prompt"),
    "parser": ("Parser", "parser"),
    "clock": ("Clock", "the clock"),
    "code": ("Code", "the code"),
}
SETTINGS = {"command": "Command", "commander": "Commander", "latency": "Latency"}
DISTURBED = TableColumn(name="disturbed", title="Disturbed", align="left")  # where anybody was
COLUMNS = (
    NAME,
    TableColumn(name="runs", title="Runs"),
    TableColumn(name="flights_of_an_episode", title="Flights"),
    *(TableColumn(name=name, title=title, align="left") for name, title in SETTINGS.items()),
    TableColumn(name="sampling", title="Sampling", align="left"),
    TableColumn(name="reasoning", title="Reasoning", align="left"),
    *(TableColumn(name=name, title=title, align="left") for name, (title, _) in WORDS.items()),
)


def setup(lineup: Lineup) -> ReportTable:
    """Return how each line was flown."""

    any_disturbed = any(entrant.setting.disturbed for entrant in lineup.entrants)
    columns = (*COLUMNS, DISTURBED) if any_disturbed else COLUMNS

    def row(entrant: Entrant) -> list[TableCell]:
        kinds = [identity(run) for run in entrant.runs]
        as_asked = {NOT_TOLD, str((entrant.runs[0].flight.get("model") or {}).get("name"))}
        told = [
            sorted({v for kind in kinds for v in kind.get(what, ())} - (as_asked if name == "served" else set()))
            for name, (_, what) in WORDS.items()
        ]
        named = [_names(entrant, column) + values for column, values in zip(WORDS, told, strict=True)]
        return [
            count(len(entrant.runs)),
            count(max(map(len, entrant.by_episode.values()), default=0)),
            *(_words(getattr(entrant.setting, name)) for name in SETTINGS),
            _words(_sampling(entrant)),
            _words(_reasoning(entrant)),
            *(_words(DIGEST.sub(r"\1", ", ".join(values))) for values in named),
            *([_words(entrant.setting.disturbed)] if any_disturbed else []),
        ]

    return ReportTable(
        name="setup",
        title="How it was flown",
        caption=(
            "Flights: of one episode, at most. Reasoning: what a question was sent to switch it, and after the bar what"
            " the question after a think was sent. As served: only where it differs from the name that was asked for."
            " Digests by their first eight letters; run.json has them whole."
        ),
        columns=columns,
        blocks=lineup.blocks(columns, row),
        notes=lineup.notes(),
        command=lineup.command,
    )


def _names(entrant: Entrant, column: str) -> list[str]:
    """Return what stands before the digests of a column: of a prompt whose it is."""
    if column != "prompt":
        return []
    names = {run.configuration.get("prompt_name") for run in entrant.runs}
    return sorted(str(name) for name in names if name)


def _sampling(entrant: Entrant) -> str:
    """Return how a model's replies were drawn, what is not sent left out."""
    model = entrant.runs[0].flight.get("model") or {}
    told = {key: model.get(key) for key in ("temperature", "top_p", "top_k", "max_tokens")}
    return ", ".join(f"{key} {value}" for key, value in told.items() if value is not None)


def _reasoning(entrant: Entrant) -> str:
    """Return what switches a model's reasoning, before and after a `think`; empty: no model, or one not known."""
    model = entrant.runs[0].flight.get("model") or {}
    provider = PROVIDERS.get(str(model.get("provider")))
    if provider is None:
        return ""
    sent = [
        provider_fields if (own := model.get(name)) is None else own
        for name, provider_fields in (("quick", provider.quick), ("thinking", provider.thinking))
    ]
    return " | ".join(", ".join(_leaves(fields)) or "nothing" for fields in sent)


def _leaves(fields: Any, name: str = "") -> Iterator[str]:
    """Yield the fields of a request in words, as reasoning.enabled false."""
    if isinstance(fields, Mapping):
        for key, inner in fields.items():
            yield from _leaves(inner, f"{name}.{key}" if name else str(key))
    else:
        yield f"{name} {fields if isinstance(fields, str) else json.dumps(fields)}"


def _words(text: str) -> TableCell:
    return TableCell(value=text or None)
