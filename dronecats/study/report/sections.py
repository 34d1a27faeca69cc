"""The sections of a study's report: what they hold and in which order, on the page and in Markdown alike."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dronecats.judge.statistics.paired import ALPHA
from dronecats.report.table import ReportTable, TableColumn, in_blocks, row, words
from dronecats.study.analysis.paired_flights import SUCCESS, PairedDifference
from dronecats.study.analysis.studied import ALL
from dronecats.study.report import difference_tables, level_tables
from dronecats.study.report.figures.drawing import StudyFigure
from dronecats.study.report.findings import FactorFindings, Findings
from dronecats.study.report.words import PERCENT, cell_title, half_sentence, points, probability

FEW = 4  # factors, of more than which the summary tells what is told apart alone
PLACED = ("within", "between")  # where half succeed at a place among the levels


@dataclass(frozen=True, slots=True)
class SectionPart:
    """Figures with the tables that tell their numbers."""

    figures: tuple[StudyFigure, ...]
    tables: tuple[ReportTable, ...]


@dataclass(frozen=True, slots=True)
class StudySection:
    """A section."""

    key: str  # of its address
    title: str
    said: tuple[str, ...]  # sentences above its parts
    parts: tuple[SectionPart, ...]

    @property
    def tables(self) -> tuple[ReportTable, ...]:
        """All tables of it."""
        return tuple(table for part in self.parts for table in part.tables)


def sections(found: Findings, figures: Sequence[StudyFigure]) -> list[StudySection]:
    """Return the sections, those that there is something to tell in."""
    drawn = {figure.name: figure for figure in figures}
    made = []
    if table := difference_tables.at_points(found):
        over = tuple(_over(found, found.studied.groups))
        made.append(StudySection("points", table.title, over, (_part(drawn, [table], "at_points"),)))
    made += [section for along in found.factors for section in _along(found, along, drawn)]
    if table := difference_tables.effects(found):
        said = ("What each factor does by itself, from one fit over all of them.",)
        made.append(StudySection("main-effects", "Main effects", said, (_part(drawn, [table], "main_effects"),)))
    maps = [_part(drawn, [table], table.name) for table in difference_tables.interactions(found)]
    if maps:
        said = (
            "Two factors together: where both hurt more than each by itself, the map is darker than its edges say.",
        )
        made.append(StudySection("interactions", "Interactions", said, tuple(maps)))
    made.append(StudySection("setup", "How it was flown", (), (_part(drawn, [setup(found)]),)))
    return made


def opening(found: Findings) -> list[str]:
    """Return what is to be known before any number, sentences."""
    studied = found.studied
    scored, flown = len(studied.scored), len(studied.flights)
    said = [
        f"{flown} flights of {len({each.scored.episode for each in studied.flights})} episodes,"
        f" {scored} of them scored; {studied.design}."
    ]
    if studied.planned > flown:
        said.append(
            f"The study is not flown to its end: {studied.planned - flown} of {studied.planned} flights are missing."
        )
    return [*said, *studied.notes]


def short(found: Findings) -> list[str]:
    """Return what the study says in a few sentences: who is better, what levels cost, and where half succeed.

    Of many factors only what is told apart from chance is told of each, and the rest in one sentence.
    """
    said, few = [*_over(found, found.studied.groups[:1])], len(found.factors) <= FEW
    for along in found.factors:
        groups = [cell for cell in found.studied.groups if cell != ALL] or list(found.studied.groups)
        halves = [each for each in along.halves if each.cell in groups and not each.beside]
        said += [half_sentence(found.studied, each) for each in halves if few or each.half.where in PLACED]
        said += [told for told, apart in _costs(found, along) if few or apart]
    if not few:
        said += _quiet(found)
    effects = [e for e in found.effects if e.cell == found.studied.groups[0] and (few or e.p_holm <= ALPHA)]
    for effect in effects:
        factor = found.studied.factors[effect.factor]
        said.append(
            f"{effect.entrant}: {factor.name.replace('_', ' ')} from {factor.told(effect.begin)} to"
            f" {factor.told(effect.end)} moves success from {PERCENT * effect.share_begin:.0f} to"
            f" {PERCENT * effect.share_end:.0f} % (fitted; p {_equals(effect.p_holm)} after Holm's correction)."
        )
    return said


def _over(found: Findings, cells: Sequence[str]) -> Iterator[str]:
    """Yield what those who fly come to over all points alike."""
    count = len({each.title for each in found.points})
    for each in (each for each in found.over_points if each.cell in cells):
        yield (
            f"{each.first} less {each.second}, {cell_title(each.cell).lower()}, over all {count} points alike:"
            f" {_success(each)}; p {_equals(each.difference.p)}."
        )


def _quiet(found: Findings) -> Iterator[str]:
    """Yield for each entrant the factors that do nothing that is told apart from chance."""
    cell = found.studied.groups[0]
    for entrant in found.studied.entrants:
        names = []
        for along in found.factors:
            told = _against_reference(along, entrant, cell)
            if told and not any(each.p_holm <= ALPHA for each in told):
                alone = _alone(told)
                names.append(along.factor.name.replace("_", " ") + (f" ({alone})" if alone else ""))
        if names:
            yield f"{entrant}, {cell_title(cell).lower()}: no level is told apart in success of {', '.join(names)}."


def _costs(found: Findings, along: FactorFindings) -> Iterator[tuple[str, bool]]:
    """Yield for each entrant what the nearest level that is told from the reference costs, and whether there is one."""
    reference = along.factor.told(along.factor.reference)
    name = "" if len(found.factors) <= FEW else f" along {along.factor.name.replace('_', ' ')}"
    for entrant in found.studied.entrants:
        cell = found.studied.groups[0]
        told = _against_reference(along, entrant, cell)
        apart = [each for each in told if each.p_holm <= ALPHA]
        if not told:
            continue
        if not apart:
            alone = _alone(told)
            reason = f" after Holm's correction ({alone})" if alone else ""
            yield (
                f"{entrant}, {cell_title(cell).lower()}: no level is told apart from {reference} in success{reason}.",
                False,
            )
            continue
        each = min(apart, key=_away)  # of words, which are no way off, the first
        told_so = (
            f"{entrant}, {cell_title(cell).lower()}{name}: {each.at.title} is the first level that is told apart from"
            f" {reference}: {_success(each)}; p {_equals(each.p_holm)} after Holm's correction."
        )
        yield told_so, True


def _against_reference(along: FactorFindings, entrant: str, cell: str) -> list[PairedDifference]:
    """Return each level's success less the reference's."""
    return [e for e in along.between_levels if (e.first, e.cell, e.metric) == (entrant, cell, SUCCESS)]


def _alone(told: Sequence[PairedDifference]) -> str:
    """Return the level that would be told apart were it the only one, and what Holm's correction makes of it, or ''."""
    each = min(told, key=lambda each: each.difference.p)
    if each.difference.p > ALPHA:
        return ""
    return (
        f"{each.at.title} by itself would be: {_success(each)}, p {_equals(each.difference.p)}; with {len(told)} levels"
        f" compared, Holm's correction makes it {probability(each.p_holm)}"
    )


def _success(told: PairedDifference) -> str:
    """Return a difference of success in words: −4 points of success (−6 to −1)."""
    known = told.difference
    interval = "" if known.low is None or known.high is None else f" ({points(known.low)} to {points(known.high)})"
    return f"{points(known.mean)} points of success{interval}"


def _away(told: PairedDifference) -> float:
    """Return how far a level lies from the one it is compared with; 0 of words."""
    at, against = told.at.at, told.against.at
    return 0.0 if at is None or against is None else abs(at - against)


def _along(found: Findings, along: FactorFindings, drawn: dict[str, StudyFigure]) -> Iterator[StudySection]:
    name, key = along.factor.name.replace("_", " "), along.factor.name.replace("_", "-")
    success, *rest = level_tables.tables(found, along)
    fits = [table for table in rest if table.name == along.named("half_success")]
    every = [table for table in rest if table not in fits]
    parts = (
        _part(drawn, [success, *fits], along.named("success"), along.named("success_beside")),
        _part(drawn, every, along.named("measures")),
    )
    pooled = found.studied.groups[0]
    several = [half_sentence(found.studied, e) for e in along.halves if e.beside and e.cell == pooled]
    yield StudySection(key, f"Along {name}", tuple(several), parts)
    pairs = [_part(drawn, [table], table.name) for table in difference_tables.tables(found, along)]
    if pairs:
        yield StudySection(f"{key}-pairs", f"Pairs along {name}", (), tuple(pairs))
    steps = [
        _part(drawn, [table], table.name)
        for table in (level_tables.motion(found, along), level_tables.served(found, along))
        if table
    ]
    if steps:
        yield StudySection(f"{key}-steps", f"Decisions along {name}", (), tuple(steps))


def _part(drawn: dict[str, StudyFigure], tables: Sequence[ReportTable], *names: str) -> SectionPart:
    return SectionPart(tuple(drawn[name] for name in names if name in drawn), tuple(tables))


def _equals(p: float) -> str:
    told = probability(p)
    return told if told.startswith("<") else f"= {told}"


def setup(found: Findings) -> ReportTable:
    """Return how the study was laid out."""
    studied = found.studied
    scored, flown = len(studied.scored), len(studied.flights)
    told = [
        ("Study", studied.name),
        ("Design", studied.design),
        *(
            (factor.title, ", ".join(factor.told(level) for level in factor.levels) if len(factor.levels) <= 24
             else f"{len(factor.levels)} levels")
            for factor in studied.factors
        ),
        ("Who flew", ", ".join(studied.entrants)),
        ("Cells", ", ".join(cell_title(cell) for cell in studied.cells)),
        ("Episodes", str(len({each.scored.episode for each in studied.flights}))),
        ("Flights", f"{flown} of {studied.planned} flown, {scored} of them scored"),
        ("Seeds", "the same flight of an episode has the same seed at every level"),
    ]  # fmt: skip
    return ReportTable(
        name="setup",
        title="How it was flown",
        caption="What the folder of the study tells.",
        columns=(words("What", "what"), TableColumn(name="told", title="", align="left")),
        blocks=in_blocks(("", row(*line)) for line in told),
        command=found.command,
    )  # fmt: skip
