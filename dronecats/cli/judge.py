"""Verbs `judge` and `audit`: verdicts derived again from logs, and the effect of other rules."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.output import show
from foundation.protocol import CAP_S, RADIUS_M
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.judge.episode import Judged
    from dronecats.judge.metrics.judging import JudgedEpisode
    from dronecats.judge.metrics.metric import MetricValue
    from dronecats.report.recorded.run import RecordedRun
    from dronecats.report.table import CellValue, ReportTable

DIFFERS = 4  # exit status: a stored verdict is not what the logs say, or the logs contradict themselves


def add_judge_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="a run folder, one episode of it, or a folder of runs"
    )
    parser.add_argument("--delta", type=float, default=RADIUS_M, help="success radius in metres (default 5)")
    parser.add_argument("--cap", type=float, default=CAP_S, help="seconds after which nothing counts (default 300)")
    parser.add_argument(
        "--metric", type=Path, action="append", default=[], metavar="FILE.py", help="measure with a file of your own"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, with every metric")
    parser.set_defaults(run=run_judge)


def run_judge(args: argparse.Namespace) -> int:
    """Print the verdicts; status 0 whatever they are, and 4 when something stored does not agree with them."""
    from dronecats.judge.metrics.judging import Judging, judged_episodes
    from dronecats.report.recorded.run import recorded_runs

    how = Judging(delta_m=args.delta, cap_s=args.cap, measured=args.json, own=tuple(args.metric))
    how.check()
    runs = recorded_runs(args.runs)
    folders = [folder for each in runs for folder in each.episodes]
    names = _names([(each.folder, folder) for each in runs for folder in each.episodes])
    told = zip(names, judged_episodes(folders, how), strict=True)
    doubtful = 0
    if args.json:
        episodes = {name: _as_json(each) for name, each in told}
        doubtful = sum(_doubtful(each) for each in episodes.values())
        print(json.dumps({"episodes": episodes}))
    else:
        judged = [(run, [next(told)[1] for _ in run.episodes]) for run in runs]
        doubtful = sum(each.judged.doubtful for _, of_run in judged for each in of_run)
        show(_table(judged))
        if len(folders) > 1:
            print(f"{counted(len(folders), 'episode')}, {doubtful} in doubt")
    return DIFFERS if doubtful else 0


def _names(found: Sequence[tuple[Path, Path]]) -> list[str]:
    """Return what each episode is called: its folder's name, with its run's before it where there are several runs."""
    runs = {run: run.name for run, _ in found}
    if len(runs) == 1:
        return [folder.resolve().name for _, folder in found]
    alike = len(set(runs.values())) < len(runs)
    return [f"{run if alike else run.name}/{folder.resolve().name}" for run, folder in found]


def _as_json(each: "JudgedEpisode") -> dict[str, Any]:
    return {**each.judged.as_json(), "failure_mode": each.mode, "metrics": {**each.values}}


def _doubtful(told: dict[str, Any]) -> bool:
    return bool(told["contradictions"]) or told["stored_agrees"] is False


def _table(judged: "Sequence[tuple[RecordedRun, Sequence[JudgedEpisode]]]") -> "ReportTable":
    """Return a row per episode, a block per run; beneath them a line for each remark about an episode."""
    from dronecats.report.table import ReportTable, in_blocks, numbers, row, words

    columns = (words("episode"), words("outcome"), numbers("NE", unit="m", decimals=2), numbers("steps"),
               numbers("declarations"), words("mode"), words("verdict.json"))  # fmt: skip
    rows, notes = [], []
    for run, episodes in judged:
        names = [folder.resolve().name for folder in run.episodes]
        title = run.folder.name if len(judged) > 1 else ""
        rows += [(title, row(*_line(name, each))) for name, each in zip(names, episodes, strict=True)]
        before = f"{title}/" if title else ""
        notes += [
            f"{before}{name}: {said}" for name, each in zip(names, episodes, strict=True) for said in _remarks(each)
        ]
    return ReportTable(columns=columns, blocks=in_blocks(rows), notes=tuple(notes))


def _line(name: str, each: "JudgedEpisode") -> "tuple[CellValue, ...]":
    verdict = each.judged.verdict
    mode = "cut off there" if verdict.outcome == "success" and verdict.censored else each.mode or ""
    return name, verdict.outcome, verdict.ne_m, verdict.steps, verdict.declarations, mode, _agreement(each.judged)


def _remarks(each: "JudgedEpisode") -> list[str]:
    """Return what is to be said of an episode beside its row."""
    from dronecats.judge.commanding import sentence as of_commanding
    from dronecats.judge.distances import sentence as of_distances

    verdict = each.judged.verdict
    said = ["cut off at its first success: whether it would have been one at this radius is not known"
            if verdict.outcome == "censored" else None]  # fmt: skip
    said.append(of_distances(verdict.distances, verdict.delta_m) if verdict.distances else None)
    said.append(of_commanding(verdict.commanding) if verdict.commanding else None)
    said += [f"{name} {_value(value)}" for name, value in each.values.items()]
    return [sentence for sentence in (*said, verdict.error, verdict.note, *each.judged.contradictions) if sentence]


def _value(value: "MetricValue | Sequence[MetricValue]") -> str:
    if isinstance(value, Sequence):
        return " ".join(map(_value, value))
    return "–" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _agreement(judged: "Judged") -> str:
    """Return what verdict.json is beside the verdict."""
    stored = judged.stored
    if stored is None:
        return "nothing stored to compare"
    version = ", stored by an older version" if stored.older else ""
    if stored.agrees:
        return f"agrees{version}"
    names = f" in {', '.join(stored.differing)}" if stored.differing else ", which is damaged"
    return f"DIFFERS{names}{version}"


if TYPE_CHECKING:
    from dronecats.judge.metrics.audit import Audit
    from dronecats.judge.metrics.deliberation import Followed


def add_audit_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="a run folder, one episode of it, or a folder of runs"
    )
    parser.add_argument("--delta", type=float, default=RADIUS_M, help="success radius in metres (default 5)")
    parser.add_argument("--cap", type=float, default=CAP_S, help="seconds after which nothing counts (default 300)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run_audit)


def run_audit(args: argparse.Namespace) -> int:
    """Print the audit of all episodes together."""
    from dronecats.judge.metrics.audit import audit, audited_episode
    from dronecats.judge.metrics.judging import Judging, of_each
    from dronecats.report.recorded.run import recorded_runs

    Judging(delta_m=args.delta, cap_s=args.cap).check()
    folders = [folder for each in recorded_runs(args.runs) for folder in each.episodes]
    told = audit(of_each(partial(audited_episode, delta_m=args.delta, cap_s=args.cap), folders))
    if args.json:
        print(json.dumps(asdict(told)))
    else:
        _print(told)
    return 0


def _print(told: "Audit") -> None:
    from dronecats.judge.metrics.audit import RULES
    from dronecats.report.table import numbers, table_of, words

    successes = counted(told.successes, "success", "successes")
    print(f"{counted(told.episodes, 'episode')}, {told.scored} scored, {successes}")
    print(
        f"{counted(told.declarations, 'declaration')}, {told.false_declarations} of which do not qualify;"
        f" {told.late_declarations} after the cap, in {counted(told.late_episodes, 'episode')}"
    )
    print(f"{counted(told.silent_failures, 'failure')} without a declaration, {told.silent_entered} within the radius")
    rules = [(said, told.flips[name]) for name, (said, _) in RULES.items()]
    rules.append(("strict parsing of what was mended", told.strict))
    columns = (words("rule"), numbers("told"), numbers("success"), numbers("lost"), numbers("gained"))
    print()
    show(table_of(columns, ((said, r.told, r.successes, r.lost, r.gained) for said, r in rules)))
    gain = "" if told.think.gain_m_per_step is None else f", {told.think.gain_m_per_step:+.2f} m/step after them"
    print(f"\nthink: {told.think.thinks} steps, {told.think.matched} matched by their closing rate{gain}")
    print(f"  a stall broken within three steps: {_share(told.think.stalls)}")
    print(f"  the target seen again within three steps: {_share(told.think.losses)}")
    print(f"mended: {told.mended} of {told.steps} decisions, {told.changed} of them another one under strict parsing")


def _share(told: "Followed") -> str:
    return f"{told.think}/{told.of_thinks} after a think, {told.other}/{told.of_others} after another step"
