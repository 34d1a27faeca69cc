"""How each line was flown, and what its flights cost: what a reader needs to fly them again."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from dronecats.agent.models.spec import PROVIDERS
from dronecats.report.cells import FLIGHTS, NAME, NONE, count
from dronecats.report.report_data import ReportData
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.results.entrants import Entrant
from dronecats.report.results.identity import DIGEST, NOT_TOLD, identity
from dronecats.report.table import ReportTable, TableCell, TableColumn

WORDS = {  # column → what of the identity stands there
    "served": ("As served", "the model as served"),
    "prompt": ("Prompt", "the prompt"),
    "parser": ("Parser", "parser"),
    "clock": ("Clock", "the clock"),
    "code": ("Code", "the code"),
}
SETTINGS = {"command": "Command", "commander": "Commander", "latency": "Latency"}
DISTURBED = TableColumn(name="disturbed", title="Disturbed", align="left")  # where anybody was
SETUP = (
    NAME,
    TableColumn(name="runs", title="Runs"),
    TableColumn(name="flights_of_an_episode", title="Flights"),
    *(TableColumn(name=name, title=title, align="left") for name, title in SETTINGS.items()),
    TableColumn(name="sampling", title="Sampling", align="left"),
    TableColumn(name="reasoning", title="Reasoning", align="left"),
    *(TableColumn(name=name, title=title, align="left") for name, (title, _) in WORDS.items()),
)


def setup(data: ReportData) -> ReportTable:
    """Return how each line was flown."""

    any_disturbed = any(entrant.setting.disturbed for entrant in data.entrants)
    columns = (*SETUP, DISTURBED) if any_disturbed else SETUP

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
        blocks=data.blocks(columns, row),
        notes=data.notes(),
        command=data.command,
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


MILLION = 1e6
COSTS = (
    NAME,
    FLIGHTS,
    TableColumn(name="questions", title="Questions", group="A flight"),
    TableColumn(name="tokens_in", title="Tokens in", group="A flight"),
    TableColumn(name="tokens_cached", title="cached", group="A flight"),
    TableColumn(name="tokens_out", title="Tokens out", group="A flight"),
    TableColumn(name="tokens_reasoning", title="reasoning", group="A flight"),
    TableColumn(name="usd_per_flight", title="$", group="A flight", unit="$", decimals=4),
    TableColumn(name="usd", title="$", group="All", unit="$", decimals=2),
    TableColumn(name="usd_per_success", title="$ a success", group="All", unit="$", decimals=4, better="less"),
    TableColumn(name="endpoints", title="Answered by", align="left"),
)


def costs(data: ReportData) -> ReportTable | None:
    """Return what each flight took; None where no tokens are told."""

    def row(entrant: Entrant) -> list[TableCell] | None:
        flown = entrant.episodes
        told = [each for each in flown if each.usage.tokens_in is not None or each.usage.tokens_out is not None]
        if not told:
            return None
        usd = dollars(flown)
        solved = sum(each.success for each in flown)
        asked = sum(each.usage.questions + each.usage.commander_questions for each in flown)
        tokens = [
            _mean([(e.usage.tokens_in or 0) + (e.usage.commander_in or 0) for e in told]),
            _mean([e.usage.cached for e in told if e.usage.cached is not None]),
            _mean([(e.usage.tokens_out or 0) + (e.usage.commander_out or 0) for e in told]),
            _mean([e.usage.reasoning for e in told if e.usage.reasoning is not None]),
        ]
        endpoints = ", ".join(sorted({name for e in told for name in e.usage.endpoints}))
        money = [NONE] * 3 if usd is None else [
            TableCell(value=usd / len(flown), of=len(flown)),
            TableCell(value=usd),
            TableCell(value=usd / solved, of=solved) if solved else NONE,
        ]  # fmt: skip
        questions = TableCell(value=asked / len(flown), of=len(flown))
        return [count(len(flown)), questions, *tokens, *money, TableCell(value=endpoints or None)]

    blocks = data.blocks(COSTS, row)
    if not blocks:
        return None
    return ReportTable(
        name="costs",
        title="Costs",
        caption=(
            "Questions and tokens a flight, means, of flights that are nobody's score too; a commander's are in them,"
            " but for its cached and reasoning tokens. Cached: of the tokens in, those that the vendor had from before;"
            " reasoning: of the tokens out; both only where the vendor tells them. $ by the prices that the runs"
            " declare, cached tokens at the full price; questions that had to be asked again, and the one before"
            " take-off, are in the ledger of the run alone. Answered by: whom a router had answer, as OpenRouter names"
            " it."
        ),
        columns=COSTS,
        blocks=blocks,
        command=data.command,
    )


def _mean(counts: Sequence[int]) -> TableCell:
    return TableCell(value=sum(counts) / len(counts), of=len(counts)) if counts else NONE


def dollars(flown: Iterable[ScoredEpisode]) -> float | None:
    """Return what these flights cost ($) by the declared prices; None where a price or a count is not known."""
    spent = 0.0
    for each in flown:
        asked = each.run.flight
        model, commander, used = asked.get("model"), asked.get("commander") or asked.get("model"), each.usage
        parts = [(model, used.questions, used.tokens_in, used.tokens_out)]
        parts.append((commander, used.commander_questions, used.commander_in, used.commander_out))
        for who, questions, tokens_in, tokens_out in parts:
            if questions == 0:
                continue
            cost = _cost(who, tokens_in, tokens_out)
            if cost is None:
                return None
            spent += cost
    return spent


def _cost(model: Mapping[str, Any] | None, tokens_in: int | None, tokens_out: int | None) -> float | None:
    prices = [(model or {}).get(key) for key in ("input_usd", "output_usd")]
    if tokens_in is None or tokens_out is None or None in prices:
        return None
    return (tokens_in * float(prices[0] or 0) + tokens_out * float(prices[1] or 0)) / MILLION
