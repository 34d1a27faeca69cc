"""What flights took: questions, tokens and money, by the prices that their runs declare."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from dronecats.report.blocks import Lineup
from dronecats.report.entries import FLIGHTS, NAME, NONE, count
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.results.entrants import Entrant

MILLION = 1e6
COLUMNS = (
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


def costs(lineup: Lineup) -> ReportTable | None:
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

    blocks = lineup.blocks(COLUMNS, row)
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
        columns=COLUMNS,
        blocks=blocks,
        command=lineup.command,
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
