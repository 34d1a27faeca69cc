"""Verifies an archive: judges its flights again, and lists the checks, the differences and the unchecked items."""

import hashlib
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec

from dronecats.agent.prompt import Prompt
from dronecats.judge.episode import compare
from dronecats.judge.metrics.judging import JudgedEpisode, Judging, judged_episodes
from dronecats.judge.statistics.shares import estimate_share
from dronecats.report.leaderboard.archive_file import FileDigest, Manifest, unpack
from dronecats.report.leaderboard.submission import common_suite, incompleteness_reason
from dronecats.report.recorded.run import RecordedRun, recorded_run
from dronecats.report.results.identity import differences, identity, identity_digest
from episodes.records import catalogue, record
from foundation.conversion import convert
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object
from foundation.run_folder.results import SCORED, Verdict
from foundation.typed_file import LARGE
from foundation.wording import printable

SHOWN_MAX = 50  # the result has at most this many sentences about differences
SHOWN_CHARS = 200  # the result has at most this many characters of a setting
OTHER_CELL = "other"  # replaces a record's cell (kind of episode) that the benchmark does not have


@dataclass(frozen=True, slots=True, kw_only=True)
class CellScore:
    """The results of the flights of one cell (kind of episode, such as searching), computed from the logs."""

    scored: int
    successes: int
    oracle_successes: int
    declared: int
    unscored: int  # number of flights that are neither a success nor a failure
    ne_m: float | None  # m, mean navigation error of the scored flights; None: unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """The output of `dronecats verify --json`, and the entry of a leaderboard."""

    name: str
    note: str
    pilot: str
    is_model: bool
    suite: str | None
    partial: str | None  # a sentence about missing or broken parts; None: complete
    flights: int  # number of flights of each episode
    steps: int
    settings: dict[str, Any]  # settings that distinguish entries of one pilot
    cells: dict[str, CellScore]
    interval: tuple[float, float]  # 95 % interval of the total success rate, 0 … 1; the statistical unit is the episode
    identity: str
    archive_sha256: str
    archive_bytes: int
    dronecats: str  # version of dronecats that wrote the archive
    verified: bool  # True: no differences
    differences: tuple[str, ...]
    checked: tuple[str, ...]
    unchecked: tuple[str, ...]


OF_MANIFEST = ("name", "note", "pilot", "is_model", "suite", "partial", "identity", "dronecats")  # copied fields


def verify(path: Path) -> Verification:
    """Check an archive against its manifest and the shipped records, and return the result.

    The archive is unpacked only to a temporary folder. Raises UsageError if the file is not such an archive, or is
    malicious.
    """
    try:
        with path.open("rb") as file, tempfile.TemporaryDirectory(prefix="dronecats-verify-") as place:
            manifest, differences, frames = unpack(file, Path(place))
            file.seek(0)
            packed = FileDigest(bytes=path.stat().st_size, sha256=hashlib.file_digest(file, "sha256").hexdigest())
            return _verification(manifest, Path(place), [*differences], frames, packed)
    except OSError as error:
        raise UsageError(f"{error.filename or path} cannot be read or unpacked: {error.strerror}") from None
    except UsageError as wrong:
        raise UsageError(f"{path}: {_on_one_line(str(wrong))}") from None
    except (OverflowError, RecursionError):  # JSON allows numbers of any length and lists of any depth
        raise UsageError(f"{path}: it has a number or a list that is impossible in a flight") from None


def _verification(
    manifest: Manifest, place: Path, differences: list[str], frames: int, packed: FileDigest
) -> Verification:
    for submitted in manifest.runs:
        _check_run(place / submitted.folder / layout.RUN)
    runs = [recorded_run(place / run.folder) for run in manifest.runs]
    verdicts: list[tuple[str, Verdict]] = []  # (cell, verdict) of each flight
    flights: dict[str, list[bool]] = {}  # episode → whether each scored flight succeeded
    for run, submitted in zip(runs, manifest.runs, strict=True):
        judged = {episode.folder.name: episode for episode in judged_episodes(run.episodes, Judging())}
        for episode in judged.keys() & {*submitted.episodes}:
            cell = str((json_object(run.folder / episode / layout.EPISODE) or {}).get("cell"))
            verdict = judged[episode].verdict
            verdicts.append((cell if cell in record.CELLS else OTHER_CELL, verdict))
            if verdict.outcome in SCORED:
                flights.setdefault(episode, []).append(verdict.outcome == "success")
        for episode in submitted.episodes:
            found_here = [*_record_differences(run, episode), *_verdict_differences(run, episode, judged[episode])]
            differences += [f"{submitted.folder}/{episode}: {difference}" for difference in found_here]
    differences += _manifest_differences(manifest, runs)
    cells, share = _cells(verdicts), estimate_share(list(flights.values()))
    unscored = sum(cell.unscored for cell in cells.values())
    if unscored and manifest.partial is None:
        differences.append(f"{unscored} episodes are not scored, but the entry is not marked as partial")
    differences = [_on_one_line(difference) for difference in differences]
    if len(differences) > SHOWN_MAX:
        differences = [*differences[:SHOWN_MAX], f"and {len(differences) - SHOWN_MAX} more"]
    return Verification(
        **{name: getattr(manifest, name) for name in OF_MANIFEST},
        flights=len(manifest.runs),
        steps=sum(verdict.steps for _, verdict in verdicts),
        settings=_settings(runs[0].configuration),
        cells=cells,
        interval=(share.low, share.high),
        archive_sha256=packed.sha256,
        archive_bytes=packed.bytes,
        verified=not differences,
        differences=tuple(differences),
        checked=CHECKED,
        unchecked=tuple(_unchecked(manifest, runs, frames)),
    )


class _KeptModel(msgspec.Struct):
    provider: str
    name: str


class _KeptOutside(msgspec.Struct):
    harness: str
    name: str


class _KeptFlight(msgspec.Struct):
    pilot: str | None = None
    model: _KeptModel | None = None
    outside: _KeptOutside | None = None
    seed: Annotated[int, msgspec.Meta(ge=0, lt=2**62)] = 0
    replay: dict[str, Any] | None = None
    seconds: float = CAP_S


class _KeptRun(msgspec.Struct):
    """The fields of run.json that this module uses."""

    flight: _KeptFlight
    versions: dict[str, str]


def _check_run(path: Path) -> None:
    try:
        convert(json_object(path), _KeptRun)
    except (msgspec.ValidationError, UnicodeError, RecursionError) as wrong:
        raise UsageError(f"{path.parent.name}/{path.name} has no valid flight: {wrong}") from None


def _on_one_line(text: str) -> str:
    """Return a sentence on one line, without control characters."""
    return printable(" ".join(text.splitlines()))


CHECKED = (
    "every file has the digest of the manifest",
    "pilot, settings, suite and completeness agree with the runs; all flights are equal except for the seed",
    "every record is the shipped one of its id",
    "every stored verdict follows from its logs",
    "the logs are consistent: frames and times, distances and positions, steps, confirmations of a commander",
    "every action follows from its reply",
)


def _record_differences(run: RecordedRun, episode: str) -> Iterator[str]:
    """Yield a sentence if the record of an episode is not the shipped one."""
    path = run.folder / episode / layout.EPISODE
    try:
        parsed = record.parse(path.read_bytes(), layout.EPISODE)
    except UsageError as wrong:
        yield str(wrong).rstrip(".")
        return
    if not catalogue.is_shipped(parsed) or parsed.id != episode:
        yield "its record is not the shipped one of its id"


def _verdict_differences(run: RecordedRun, episode: str, judged: JudgedEpisode) -> Iterator[str]:
    """Yield the differences between the stored and the new verdict, and the contradictions in the logs."""
    stored = json_object(run.folder / episode / layout.VERDICT)
    if stored is None:
        yield f"{layout.VERDICT} is missing"
    else:
        now = judged.verdict.as_json()
        for words in ("error", "note"):  # not compared, because they may have file paths of another machine
            if isinstance(stored.get(words), str) and isinstance(now.get(words), str):
                now[words] = stored[words]
        if differing := compare(stored, now).differing:
            yield f"the verdict differs from {layout.VERDICT} in {', '.join(differing[:5])}"
    yield from judged.contradictions


def _manifest_differences(manifest: Manifest, runs: Sequence[RecordedRun]) -> Iterator[str]:
    first = runs[0]
    if (manifest.pilot, manifest.is_model) != (first.pilot, first.is_model):
        yield f"the entry names the pilot {manifest.pilot}, but its runs are of {first.pilot}"
    if identity_digest(identity(first)) != manifest.identity:
        yield f"{manifest.runs[0].folder} has other settings than the entry"
    for submitted, run in zip(manifest.runs, runs, strict=True):
        if differing := differences(identity(first), identity(run)):
            yield f"{submitted.folder} has other settings than the entry: {', '.join(map(str, differing))}"
        if run.seed != submitted.seed or [e.name for e in run.episodes] != [*submitted.episodes]:
            yield f"{submitted.folder} has another seed or other episodes than the entry"
        if run.flight.get("replay") is not None:
            yield f"{submitted.folder} is a replay of a recorded flight"
    if len({run.seed for run in runs}) != len(runs):
        yield "several of its flights have the same seed"
    flights = [run.episodes for run in manifest.runs]
    if manifest.suite != (suite := common_suite(flights)):
        yield f"the entry names the suite {manifest.suite}, but its runs have {suite or 'no complete suite'}"
    missing = incompleteness_reason(flights)
    if missing and manifest.partial is None:
        yield f"{missing}, but the entry is not marked as partial"


def _cells(verdicts: Sequence[tuple[str, Verdict]]) -> dict[str, CellScore]:
    cells: dict[str, CellScore] = {}
    for cell in (*record.CELLS, OTHER_CELL):
        of_it = [verdict for of, verdict in verdicts if of == cell]
        scored = [verdict for verdict in of_it if verdict.outcome in SCORED]
        errors_m = [verdict.ne_m for verdict in scored if verdict.ne_m is not None]
        if of_it:
            cells[cell] = CellScore(
                scored=len(scored),
                successes=sum(verdict.outcome == "success" for verdict in scored),
                oracle_successes=sum(bool(v.diagnostics and v.diagnostics.oracle_success) for v in scored),
                declared=sum(verdict.declarations > 0 for verdict in scored),
                unscored=len(of_it) - len(scored),
                ne_m=round(math.fsum(errors_m) / len(errors_m), 4) if errors_m else None,
            )
    return cells


VERSION_KEY = "suite version"
SETTING_KEYS = ("command", "commander", "scripted", "latency", "parser", "drones", "seconds", "model")


def _settings(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that distinguish entries of one pilot, including the settings of a model."""
    flight = configuration["flight"]
    settings = {key: flight[key] for key in SETTING_KEYS if flight.get(key) is not None}
    settings |= {"agent": configuration.get("agent")}
    suite = configuration.get("suite")
    settings |= {VERSION_KEY: suite.get("version")} if isinstance(suite, dict) else {}
    settings |= {"disturbed": on_purpose} if (on_purpose := configuration.get("disturbed")) else {}
    return {key: _shown(value) for key, value in settings.items()}


def _shown(value: Any, depth: int = 3) -> Any:
    """Return a setting of any type in a short form that is safe to print."""
    if isinstance(value, dict) and depth:
        return {_on_one_line(key)[:SHOWN_CHARS]: _shown(inner, depth - 1) for key, inner in value.items()}
    if value is None or isinstance(value, bool) or (isinstance(value, int | float) and abs(value) < LARGE):
        return value
    return _on_one_line(str(value)[:SHOWN_CHARS])


def _unchecked(manifest: Manifest, runs: Sequence[RecordedRun], frames: int) -> Iterator[str]:
    """Yield a sentence for each property that an archive cannot prove."""
    yield "the origin of truth.jsonl: another program can write consistent files"
    yield "the choice of flights: bad ones may be left out"
    yield "the code: it may differ from the version that it names"
    if manifest.is_model:
        yield f"the origin of the replies: {manifest.pilot} is only the name in the requests"
        yield "the replies: a reply and its action can be changed together"
    else:
        yield "the origin of the replies: to check it, fly again; a built-in pilot gives the same replies in lockstep"
    if frames:
        yield f"the images: of {frames} frames, only the digests were compared"
    else:
        yield "the images: the archive has only their digests"
    if any(name.endswith(layout.TLOG) for name in manifest.left_out):
        yield f"the telemetry: the archive has only the digest of each {layout.TLOG}"
    if manifest.scrubbed:
        yield f"{len(manifest.scrubbed)} files in their original form: keys or paths were removed from them"
    yield from _unusual(runs[0].configuration)


def _unusual(configuration: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each setting that differs from the benchmark's setting."""
    flight = configuration["flight"]
    if configuration.get("prompt_sha256") != Prompt.load().digest:
        yield "the prompt: it is not the one that ships with DroneCATS"
    if flight.get("seconds", CAP_S) != CAP_S:
        yield f"whole episodes: the length of a flight was {flight.get('seconds')} s"
    if flight.get("simulated") is None:
        yield "the vehicle and its truth: the vehicle was not simulated"
    elif configuration.get("camera") is None and flight.get("model") is not None:
        yield "how the pilot found its way: nothing was rendered, and its images were grey"
