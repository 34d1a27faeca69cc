"""Makes the tables of settings and of costs, with a row per entrant (a pilot with its flights)."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace

from dronecats.agent.models.spec import PROVIDERS
from dronecats.report.report_data import FLIGHTS, NAME, NONE, Cells, Entrant, ReportData, by_entrant
from dronecats.report.results.collection import ScoredEpisode, Usage
from dronecats.report.results.identity import DIGEST, NOT_RECORDED, identity, leaves
from dronecats.report.table import ReportTable, TableCell, TableColumn, words

IDENTITY_COLUMNS = {  # column → its title, and the key of `identity` whose value it shows
    "served": ("As served", "the model as served"),
    "prompt": ("Prompt", "the prompt"),
    "parser": ("Parser", "parser"),
    "clock": ("Clock", "the clock"),
    "code": ("Code", "the code"),
}
SETUP = (
    NAME,
    TableColumn(name="runs", title="Runs"),
    TableColumn(name="flights_of_an_episode", title="Flights"),
    words("Command", "command"),
    words("Commander", "commander"),
    words("Latency", "latency"),
    words("Sampling", "sampling"),
    words("Reasoning", "reasoning"),
    *(words(title, name) for name, (title, _) in IDENTITY_COLUMNS.items()),
)


def setup(data: ReportData) -> ReportTable | None:
    any_disturbed = any(entrant.setting.disturbed for entrant in data.entrants)

    def row_of(entrant: Entrant) -> Cells:
        setting = entrant.setting
        texts = [setting.command, setting.commander, setting.latency, _sampling(entrant), _reasoning(entrant)]
        kinds = [identity(run) for run in entrant.runs]
        for column, (_, name) in IDENTITY_COLUMNS.items():
            values = {value for kind in kinds for value in kind.get(name, ())}
            if column == "served":  # show it only if it differs from the requested name
                values -= {NOT_RECORDED, str((entrant.runs[0].flight.get("model") or {}).get("name"))}
            names = {run.configuration.get("prompt_name") for run in entrant.runs} if column == "prompt" else set()
            texts.append(DIGEST.sub(r"\1", ", ".join([*sorted(str(name) for name in names if name), *sorted(values)])))
        texts += [setting.disturbed] if any_disturbed else []
        flights = max(map(len, entrant.by_episode.values()), default=0)
        return [len(entrant.runs), flights, *(text or None for text in texts)]

    return data.table(
        name="setup",
        title="Settings of the flights",
        caption=(
            "Flights: largest number of flights of one episode. Reasoning: fields of a request"
            " that set it; after the bar,"
            " the fields of the request after a think. As served: the model's name in the"
            " replies, if it differs from the"
            " requested one. Digests: first eight letters; run.json has them in full."
        ),
        columns=(*SETUP, words("Disturbed", "disturbed")) if any_disturbed else SETUP,
        row_of=row_of,
        notes=data.notes(),
    )


def _sampling(entrant: Entrant) -> str:
    """Return the sampling parameters that were sent to a model."""
    model = entrant.runs[0].flight.get("model") or {}
    sent = {key: model.get(key) for key in ("temperature", "top_p", "top_k", "max_tokens")}
    return ", ".join(f"{key} {value}" for key, value in sent.items() if value is not None)


def _reasoning(entrant: Entrant) -> str:
    """Return the request fields for reasoning: `of most steps | after a think`; empty: unknown, or no model."""
    model = entrant.runs[0].flight.get("model") or {}
    provider = PROVIDERS.get(str(model.get("provider")))
    if provider is None:
        return ""
    sent = [
        provider_fields if (own := model.get(name)) is None else own
        for name, provider_fields in (("quick", provider.quick), ("thinking", provider.thinking))
    ]
    texts = (
        ", ".join(f"{name} {leaf if isinstance(leaf, str) else json.dumps(leaf)}" for name, leaf in leaves(fields))
        for fields in sent
    )
    return " | ".join(text or "nothing" for text in texts)


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
    TableColumn(name="usd_per_success", title="$ per success", group="All", unit="$", decimals=4, better="less"),
    words("Answered by", "endpoints"),
)


@by_entrant(
    title="Costs",
    caption=(
        "Questions and tokens per flight: means over all flights, unscored ones too. A commander's questions"
        " are included if it is a model, but not its cached and reasoning tokens. Cached: tokens in that the"
        " vendor had cached. Reasoning: tokens out for reasoning. Both are known only if the vendor reports"
        " them. $: by the prices in the runs, cached tokens at the full price. Repeated questions, and the"
        " test question before take-off, are only in the run's ledger. Answered by: the provider that a router"
        " such as OpenRouter chose."
    ),
    columns=COSTS,
)
def costs(entrant: Entrant) -> Cells | None:
    """Return the tokens and the price of each entrant's flights; None if no tokens were logged."""
    flights = entrant.episodes
    usages = [_model_usage(flight) for flight in flights]
    logged = [usage for usage in usages if usage.tokens_in is not None or usage.tokens_out is not None]
    if not logged:
        return None
    questions = sum(usage.questions + usage.commander_questions for usage in usages)
    usd, solved = _dollars(flights), sum(flight.success for flight in flights)
    return [
        len(flights),
        _per(questions, len(flights)),
        _mean([(usage.tokens_in or 0) + (usage.commander_in or 0) for usage in logged]),
        _mean([usage.cached for usage in logged if usage.cached is not None]),
        _mean([(usage.tokens_out or 0) + (usage.commander_out or 0) for usage in logged]),
        _mean([usage.reasoning for usage in logged if usage.reasoning is not None]),
        _per(usd, len(flights)),
        usd,
        _per(usd, solved),
        ", ".join(sorted({name for usage in logged for name in usage.endpoints})) or None,
    ]


def _model_usage(flight: ScoredEpisode) -> Usage:
    """Return the usage of a flight's models. A built-in commander is not a model, so its questions are left out."""
    if not flight.run.flight.get("scripted"):
        return flight.usage
    return replace(flight.usage, commander_questions=0, commander_in=None, commander_out=None)


def _mean(counts: Sequence[int]) -> TableCell:
    return _per(sum(counts), len(counts))


def _per(amount: float | None, count: int) -> TableCell:
    return NONE if amount is None or not count else TableCell(value=amount / count, of=count)


def _dollars(flights: Iterable[ScoredEpisode]) -> float | None:
    """Return the cost of these flights ($) by the declared prices; None if a price or a count is unknown."""
    usd = 0.0
    for flight in flights:
        model, usage = flight.run.flight.get("model"), _model_usage(flight)
        commander = flight.run.flight.get("commander") or model
        for prices, questions, tokens_in, tokens_out in (
            (model, usage.questions, usage.tokens_in, usage.tokens_out),
            (commander, usage.commander_questions, usage.commander_in, usage.commander_out),
        ):
            if questions == 0:
                continue
            input_usd, output_usd = ((prices or {}).get(key) for key in ("input_usd", "output_usd"))  # $ per 1e6 tokens
            if tokens_in is None or tokens_out is None or input_usd is None or output_usd is None:
                return None
            usd += (tokens_in * float(input_usd) + tokens_out * float(output_usd)) / 1e6
    return usd


TABLES = (costs, setup)
