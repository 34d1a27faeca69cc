"""Composes the sections and the summary of a study's report, for the HTML page and for Markdown."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dronecats.judge.statistics.shares import ALPHA
from dronecats.report.table import ReportTable, TableColumn, in_blocks, row, words
from dronecats.study.analysis.differences import SUCCESS, PairedDifference
from dronecats.study.analysis.study_results import ALL
from dronecats.study.factors import FACTORS
from dronecats.study.report import tables
from dronecats.study.report.drawing import StudyFigure
from dronecats.study.report.findings import (
    PERCENT,
    FactorFindings,
    Findings,
    cell_title,
    equals_p,
    half_sentence,
    in_cell,
    points,
    probability,
)

FACTORS_FEW = 4  # with more factors than this, the summary names only significant results
PLACED = ("within", "between")  # values of HalfSuccess.where if half success lies in the range of flown levels


@dataclass(frozen=True, slots=True)
class SectionBlock:
    figures: tuple[StudyFigure, ...]
    tables: tuple[ReportTable, ...]


@dataclass(frozen=True, slots=True)
class StudySection:
    key: str  # id of the section in the HTML page, for links to it
    title: str
    sentences: tuple[str, ...]  # text above the blocks
    blocks: tuple[SectionBlock, ...]


@dataclass(frozen=True, slots=True)
class ReportContent:
    """The content of a study's report, shared by the HTML page and Markdown."""

    title: str
    opening: tuple[str, ...]  # sentences above the results: flights, design and limits
    summary: tuple[str, ...]
    sections: tuple[StudySection, ...]
    command: str  # command line that makes the report

    @property
    def tables(self) -> tuple[ReportTable, ...]:
        return tuple(table for section in self.sections for block in section.blocks for table in block.tables)


def report_content(findings: Findings, figures: Sequence[StudyFigure]) -> ReportContent:
    """Return the content of the report with these figures. Sections without content are left out."""
    return ReportContent(
        title=f"Study: {findings.results.name}",
        opening=tuple(opening(findings)),
        summary=tuple(summary(findings)),
        sections=tuple(_sections(findings, figures)),
        command=findings.command,
    )


def _sections(findings: Findings, figures: Sequence[StudyFigure]) -> list[StudySection]:
    by_name = {figure.name: figure for figure in figures}
    section_list = []
    if table := tables.point_differences(findings):
        sentences = tuple(_pooled_sentences(findings, findings.results.groups))
        section_list.append(StudySection("points", table.title, sentences, (_block(by_name, [table], "at_points"),)))
    for along in findings.factors:
        section_list += _factor_sections(findings, along, by_name)
    if table := tables.effects(findings):
        text = "The effect of each factor by itself, from one fit over all factors."
        section_list.append(StudySection("main-effects", table.title, (text,), (_block(by_name, [table], table.name),)))
    if maps := [_block(by_name, [table], table.name) for table in tables.interactions(findings)]:
        text = (
            "Two factors interact if the effect of one depends on the level of the other. If both together reduce"
            " success by more than the sum of their effects, the field where they meet is darker than its row and"
            " column suggest."
        )
        section_list.append(StudySection("interactions", "Interactions", (text,), tuple(maps)))
    table = setup(findings)
    return [*section_list, StudySection("setup", table.title, (), (_block(by_name, [table]),))]


def opening(findings: Findings) -> list[str]:
    """Return the sentences above the results: flights, design, and limits of the comparison."""
    results = findings.results
    scored, flights = len(results.scored), len(results.flights)
    sentences = [
        f"{flights} flights of {len({flight.scored.episode for flight in results.flights})} episodes,"
        f" {scored} of them scored; {results.design}."
    ]
    if results.planned > flights:
        sentences.append(
            f"The study is not complete: {results.planned - flights} of {results.planned} flights are missing."
        )
    return [*sentences, *results.notes]


def summary(findings: Findings) -> list[str]:
    """Return the main results as sentences: differences between entrants, effects of levels, half-success levels.

    An entrant is a pilot. A half-success level is the level of a factor at which half of the flights succeed.
    With many factors, only significant results get sentences; one sentence per entrant lists the other factors.
    """
    few = len(findings.factors) <= FACTORS_FEW
    sentences = [*_pooled_sentences(findings, findings.results.groups[:1])]
    for along in findings.factors:
        groups = [cell for cell in findings.results.groups if cell != ALL] or list(findings.results.groups)
        halves = [fit for fit in along.halves if fit.cell in groups and not fit.beside]
        sentences += [half_sentence(findings.results, fit) for fit in halves if few or fit.half.where in PLACED]
        sentences += [text for text, is_significant in _cost_sentences(findings, along) if few or is_significant]
    if not few:
        sentences += _insignificant_factors(findings)
    for effect in findings.effects:
        if effect.cell == findings.results.groups[0] and (few or effect.p_holm <= ALPHA):
            factor = findings.results.factors[effect.factor]
            sentences.append(
                f"{effect.entrant}: {factor.words} from {factor.label(effect.begin)} to {factor.label(effect.end)}"
                f" changes success from {PERCENT * effect.share_begin:.0f} to {PERCENT * effect.share_end:.0f} %"
                f" (logistic regression on all factors; p {equals_p(effect.p_holm)} after Holm's correction)."
            )
    return sentences


def _pooled_sentences(findings: Findings, cells: Sequence[str]) -> Iterator[str]:
    """Yield a sentence on the difference of each pair of entrants, pooled over all points."""
    count = len({row.at for row in findings.points})
    for difference in findings.pooled:
        if difference.cell in cells:
            entrants = in_cell(f"{difference.first} minus {difference.second}", difference.cell)
            p = equals_p(difference.difference.p)
            where = f", over all {count} points" if count > 1 else ""
            yield f"{entrants}{where}: {_success_text(difference)}; p {p}."


def _insignificant_factors(findings: Findings) -> Iterator[str]:
    """Yield a sentence per entrant that lists the factors without a significant effect."""
    cell = findings.results.groups[0]
    for entrant in findings.results.entrants:
        names = []
        for along in findings.factors:
            rows = _against_reference(along, entrant, cell)
            if rows and not any(row.p_holm <= ALPHA for row in rows):
                alone = _uncorrected(rows)
                names.append(along.factor.words + (f" ({alone})" if alone else ""))
        if names:
            text = f"no level differs significantly in success along {', '.join(names)}"
            yield f"{in_cell(entrant, cell)}: in pairs of flights, {text}."


def _cost_sentences(findings: Findings, along: FactorFindings) -> Iterator[tuple[str, bool]]:
    """Yield (sentence, whether a level differs significantly from the reference) for each entrant.

    The sentence gives the nearest level that differs and the difference in success, or says that no level differs.
    """
    reference = along.factor.label(along.factor.reference)
    for entrant in findings.results.entrants:
        cell = findings.results.groups[0]
        subject = f"{in_cell(entrant, cell)}, pairs along {along.factor.words}"
        rows = _against_reference(along, entrant, cell)
        significant = [row for row in rows if row.p_holm <= ALPHA]
        if significant:
            nearest = min(significant, key=_distance)  # if levels are words, all distances are 0: the first row
            text = (
                f"{subject}: {nearest.at.title} is the first level that differs significantly from {reference}:"
                f" {_success_text(nearest)}; p {equals_p(nearest.p_holm)} after Holm's correction."
            )
            yield text, True
        elif rows:
            alone = _uncorrected(rows)
            reason = f" after Holm's correction ({alone})" if alone else ""
            yield f"{subject}: no level differs significantly in success from {reference}{reason}.", False


def _against_reference(along: FactorFindings, entrant: str, cell: str) -> list[PairedDifference]:
    """Return an entrant's differences in success between each level and the reference, in one kind of episode."""
    return [row for row in along.between_levels if (row.first, row.cell, row.metric) == (entrant, cell, SUCCESS)]


def _uncorrected(rows: Sequence[PairedDifference]) -> str:
    """Return a text on the level that is significant only without Holm's correction; empty if there is none."""
    best = min(rows, key=lambda row: row.difference.p)
    if best.difference.p > ALPHA:
        return ""
    return (
        f"{best.at.title} is significant if it is the only test: {_success_text(best)}, p"
        f" {equals_p(best.difference.p)}; with {len(rows)} levels compared, Holm's correction makes it"
        f" {probability(best.p_holm)}"
    )


def _success_text(row: PairedDifference) -> str:
    """Return a difference of success as text, for example: −4 points of success (−6 to −1)."""
    low, high = row.difference.low, row.difference.high
    interval = "" if low is None or high is None else f" ({points(low)} to {points(high)})"
    return f"{points(row.difference.mean)} points of success{interval}"


def _distance(row: PairedDifference) -> float:
    """Return the distance between the two levels of a difference; 0 if the levels are words."""
    at, against = row.at.at, row.against.at
    return 0.0 if at is None or against is None else abs(at - against)


def _factor_sections(
    findings: Findings, along: FactorFindings, figures: dict[str, StudyFigure]
) -> Iterator[StudySection]:
    name, key = along.factor.words, along.factor.name.replace("_", "-")
    fits = tables.half_success(findings, along)
    names = along.artifact_name("success"), along.artifact_name("success_beside")
    blocks: tuple[SectionBlock, ...] = (
        _block(figures, [tables.success(findings, along), *([fits] if fits else [])], *names),
        _block(figures, [tables.measures(findings, along)], along.artifact_name("measures")),
    )
    cell = findings.results.groups[0]
    sentences = [half_sentence(findings.results, fit) for fit in along.halves if fit.beside and fit.cell == cell]
    if factor := FACTORS.get(along.factor.name):
        sentences.insert(0, f"{name.capitalize()}: {factor.help.replace('`', '')}.")
    yield StudySection(key, f"Along {name}", tuple(sentences), blocks)
    pairs = tables.between_levels(findings, along), tables.between_entrants(findings, along)
    steps = tables.target_motion(findings, along), tables.served_rates(findings, along)
    for suffix, title, several in (("pairs", "Pairs", pairs), ("steps", "Decisions", steps)):
        if blocks := tuple(_block(figures, [table], table.name) for table in several if table):
            yield StudySection(f"{key}-{suffix}", f"{title} along {name}", (), blocks)


def _block(figures: dict[str, StudyFigure], block_tables: Sequence[ReportTable], *names: str) -> SectionBlock:
    return SectionBlock(tuple(figures[name] for name in names if name in figures), tuple(block_tables))


def setup(findings: Findings) -> ReportTable:
    results = findings.results
    scored, flights = len(results.scored), len(results.flights)
    lines = [
        ("Study", results.name),
        ("Design", results.design),
        *(
            (factor.title, ", ".join(factor.label(level) for level in factor.levels) if len(factor.levels) <= 24
             else f"{len(factor.levels)} levels")
            for factor in results.factors
        ),
        ("Entrants", ", ".join(results.entrants)),
        ("Cells", ", ".join(cell_title(cell) for cell in results.cells)),
        ("Episodes", str(len({flight.scored.episode for flight in results.flights}))),
        ("Flights", f"{flights} of {results.planned} flown, {scored} of them scored"),
        ("Seeds", "the same flight of an episode has the same seed at every level"),
    ]  # fmt: skip
    return ReportTable(
        name="setup",
        title="Settings",
        caption="Design and flights, from study.json.",
        columns=(words("What", "what"), TableColumn(name="value", title="", align="left")),
        blocks=in_blocks(("", row(*line)) for line in lines),
        command=findings.command,
    )  # fmt: skip
