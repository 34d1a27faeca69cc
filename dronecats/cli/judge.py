"""Verbs `judge` and `audit`: derive verdicts again from logs, and count the effect of other rules."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.next_commands import print_next
from dronecats.cli.output import show
from dronecats.report.table import CellValue, ReportTable, in_blocks, numbers, row, table_of, words
from foundation.protocol import CAP_S, RADIUS_M
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.judge.metrics.audit import Audit, Followed
    from dronecats.judge.metrics.judging import JudgedEpisode
    from dronecats.judge.metrics.metric import MetricValue
    from dronecats.report.recorded.run import RecordedRun

DIFFERS = 4  # exit status: a stored verdict differs from the logs, or the logs contradict themselves


def add_judge_options(parser: argparse.ArgumentParser) -> None:
    _add_rules(parser)
    parser.add_argument(
        "--metric",
        type=Path,
        action="append",
        default=[],
        metavar="FILE.py",
        help="also compute your own metrics, from this file",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, with every metric")
    parser.set_defaults(run=_judge)


def _add_rules(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="a run folder, one episode of it, or a folder of runs"
    )
    parser.add_argument("--delta", type=float, default=RADIUS_M, help="success radius in metres (default 5)")
    parser.add_argument(
        "--cap", type=float, default=CAP_S, help="time limit in seconds; later declarations do not count (default 300)"
    )


def _judge(args: argparse.Namespace) -> int:
    """Print the verdicts. Return 4 if a stored verdict differs or logs contradict themselves, else 0."""
    from dronecats.judge.metrics.judging import Judging, judged_episodes
    from dronecats.report.recorded.run import recorded_runs

    judging = Judging(delta_m=args.delta, cap_s=args.cap, measured=args.json, own=tuple(args.metric))
    judging.check()
    runs = recorded_runs(args.runs)
    folders = [folder for run in runs for folder in run.episodes]
    names = _names([(run.folder, folder) for run in runs for folder in run.episodes])
    results = zip(names, judged_episodes(folders, judging), strict=True)
    if args.json:
        episodes = {name: episode.as_json() for name, episode in results}
        doubtful = sum(bool(row["contradictions"]) or row["stored_agrees"] is False for row in episodes.values())
        print(json.dumps({"episodes": episodes}))
    else:
        judged = [(run, [next(results)[1] for _ in run.episodes]) for run in runs]
        doubtful = sum(episode.doubtful for _, of_run in judged for episode in of_run)
        show(_table(judged))
        if len(folders) > 1:
            print(f"{counted(len(folders), 'episode')}, {doubtful} with a difference or contradiction")
        print_next("judge", runs=args.runs)
    return DIFFERS if doubtful else 0


def _names(folders: Sequence[tuple[Path, Path]]) -> list[str]:
    """Return a name per (run, episode) folder: EPISODE, or RUN/EPISODE if there are several runs."""
    runs = {run: run.name for run, _ in folders}
    if len(runs) == 1:
        return [folder.resolve().name for _, folder in folders]
    ambiguous = len(set(runs.values())) < len(runs)
    return [f"{run if ambiguous else run.name}/{folder.resolve().name}" for run, folder in folders]


def _table(judged: "Sequence[tuple[RecordedRun, Sequence[JudgedEpisode]]]") -> ReportTable:
    """Return a table with a row per episode and a block per run. Remarks about episodes are notes of the table."""
    columns = (words("episode"), words("outcome"), numbers("NE", unit="m", decimals=2), numbers("steps"),
               numbers("declarations"), words("mode"), words("verdict.json"))  # fmt: skip
    rows, notes = [], []
    for run, episodes in judged:
        title = run.folder.name if len(judged) > 1 else ""
        prefix = f"{title}/" if title else ""
        for folder, episode in zip(run.episodes, episodes, strict=True):
            name = folder.resolve().name
            rows.append((title, row(*_line(name, episode))))
            notes += [f"{prefix}{name}: {remark}" for remark in _remarks(episode)]
    return ReportTable(columns=columns, blocks=in_blocks(rows), notes=tuple(notes))


def _line(name: str, episode: "JudgedEpisode") -> tuple[CellValue, ...]:
    verdict = episode.verdict
    mode = "ended at success" if verdict.outcome == "success" and verdict.censored else episode.mode or ""
    return name, verdict.outcome, verdict.ne_m, verdict.steps, verdict.declarations, mode, _agreement(episode)


def _remarks(episode: "JudgedEpisode") -> list[str]:
    from dronecats.judge.commanding import commanding_sentence
    from dronecats.judge.diagnostics import distances_sentence

    verdict = episode.verdict
    remarks = [
        "the flight ended before it could fail at this radius and cap, so its outcome there is not known"
        if verdict.outcome == "censored"
        else None,
        distances_sentence(verdict.distances, verdict.delta_m) if verdict.distances else None,
        commanding_sentence(verdict.commanding) if verdict.commanding else None,
        *(f"{name} {_value(value)}" for name, value in episode.values.items()),
        verdict.error,
        verdict.note,
        *episode.contradictions,
    ]
    return [remark for remark in remarks if remark]


def _value(value: "MetricValue | Sequence[MetricValue]") -> str:
    if isinstance(value, Sequence):
        return " ".join(map(_value, value))
    return "–" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _agreement(episode: "JudgedEpisode") -> str:
    """Return a text on the agreement between verdict.json and the derived verdict."""
    stored = episode.stored
    if stored is None:
        return "no stored verdict"
    version = ", stored by an older version" if stored.older else ""
    if stored.agrees:
        return f"agrees{version}"
    names = f" in {', '.join(stored.differing)}" if stored.differing else ", which is damaged"
    return f"DIFFERS{names}{version}"


def add_audit_options(parser: argparse.ArgumentParser) -> None:
    _add_rules(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_audit)


def _audit(args: argparse.Namespace) -> int:
    """Print how many verdicts of all episodes would change under other rules."""
    from dronecats.judge.metrics.audit import audit, audited_episode
    from dronecats.judge.metrics.judging import Judging, parallel_map
    from dronecats.report.recorded.run import recorded_runs

    Judging(delta_m=args.delta, cap_s=args.cap).check()
    folders = [folder for run in recorded_runs(args.runs) for folder in run.episodes]
    result = audit(parallel_map(partial(audited_episode, delta_m=args.delta, cap_s=args.cap), folders))
    if args.json:
        print(json.dumps(asdict(result)))
    else:
        _print(result)
    return 0


def _print(audit: "Audit") -> None:
    from dronecats.judge.metrics.audit import RULES

    successes = counted(audit.successes, "success", "successes")
    print(f"{counted(audit.episodes, 'episode')}, {audit.scored} scored, {successes}")
    print(
        f"{counted(audit.declarations, 'declaration')}, {audit.false_declarations} of which do not qualify;"
        f" {audit.late_declarations} after the time limit, in {counted(audit.late_episodes, 'episode')}"
    )
    print(
        f"{counted(audit.silent_failures, 'failure')} without a declaration; in {audit.silent_entered} of them a"
        " drone came within the radius"
    )
    rules = [(text, audit.flips[name]) for name, (text, _) in RULES.items()]
    rules.append(("strict parsing of repaired replies", audit.strict))
    columns = (words("rule"), numbers("episodes"), numbers("success"), numbers("lost"), numbers("gained"))
    print()
    caption = (
        "Episodes: scored episodes whose logs show the outcome by this rule. Success: successes of these by the"
        " paper's rule. Lost, gained: successes that this rule would remove or add."
    )
    cells = ((text, r.decided, r.successes, r.lost, r.gained) for text, r in rules)
    show(table_of(columns, cells, caption))
    gain = audit.think.gain_m_per_step
    print(
        f"\nthink: {counted(audit.think.thinks, 'step')}, {audit.think.matched} compared with other steps of equal"
        f" closing rate{'' if gain is None else f'; gain {gain:+.2f} m per step'}"
    )
    print(f"  stalls that ended within three steps: {_share(audit.think.stalls)}")
    print(f"  lost targets that were seen again within three steps: {_share(audit.think.losses)}")
    print(
        f"repaired replies: {audit.mended} of {audit.steps} decisions; strict parsing changes {audit.changed} of"
        " these decisions"
    )


def _share(count: "Followed") -> str:
    return f"{count.think}/{count.of_thinks} after a think, {count.other}/{count.of_others} after other steps"
