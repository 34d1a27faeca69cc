"""Who flew how: what a reader must know to fly a line of the tables again."""

from dronecats.results.entrants import Entrant
from dronecats.results.identity import DIGEST, identity
from dronecats.review.entries import NAME, count
from dronecats.review.lineup import Lineup
from dronecats.review.report_table import ReportTable, TableCell, TableColumn

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
    *(TableColumn(name=name, title=title, align="left") for name, (title, _) in WORDS.items()),
)


def setup(lineup: Lineup) -> ReportTable:
    """Return how each line was flown."""

    any_disturbed = any(entrant.setting.disturbed for entrant in lineup.entrants)
    columns = (*COLUMNS, DISTURBED) if any_disturbed else COLUMNS

    def row(entrant: Entrant) -> list[TableCell]:
        kinds = [identity(run) for run in entrant.runs]
        told = [sorted({value for kind in kinds for value in kind.get(what, ())}) for _, what in WORDS.values()]
        named = [_names(entrant, column) + values for column, values in zip(WORDS, told, strict=True)]
        return [
            count(len(entrant.runs)),
            count(max(map(len, entrant.by_episode.values()), default=0)),
            *(_words(getattr(entrant.setting, name)) for name in SETTINGS),
            _words(_sampling(entrant)),
            *(_words(DIGEST.sub(r"\1", ", ".join(values))) for values in named),
            *([_words(entrant.setting.disturbed)] if any_disturbed else []),
        ]

    return ReportTable(
        name="setup",
        title="How it was flown",
        caption="Flights: of one episode, at most. Digests by their first eight letters; run.json has them whole.",
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


def _words(text: str) -> TableCell:
    return TableCell(value=text or None)
