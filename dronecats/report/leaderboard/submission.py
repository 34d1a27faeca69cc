"""Packs run folders into an archive: the flights of one pilot under one configuration.

An archive with missing episodes or unscored flights is marked as partial. `submit` removes API keys, and the folders
of absolute paths.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

from dronecats import __version__
from dronecats.judge.episode import verdict_of
from dronecats.report.leaderboard.archive_file import (
    EPISODE_NAME,
    LOGS,
    MANIFEST,
    NAME_CHARS,
    NOTE_CHARS,
    SCHEMA,
    FileDigest,
    Manifest,
    SubmittedRun,
    write,
)
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.identity import Identity, differences, identity, identity_digest
from episodes.records import catalogue
from foundation.errors import UsageError
from foundation.files import whole_file
from foundation.redaction import HIDDEN, hide_secrets, keyless_environment, redacted, worth_hiding
from foundation.run_folder import layout
from foundation.run_folder.results import SCORED

# Patterns of the vendors' API keys; they also find keys that are no longer in an environment variable.
KEYS = re.compile(
    r"\b(?:sk-[\w-]{16,}|AIza[\w-]{30,}|(?:hf|gsk|r8|nvapi)[_-][\w-]{20,}|xai-\w{20,}|gh[pousr]_\w{30,}|AKIA[0-9A-Z]{16}"
    r"|eyJ[\w-]{10,}\.[\w-]{10,}\.[\w-]*)|(?<=Bearer )[\w.~+/-]{12,}=*"
)
_PIECE = r"[^\s/\\\"'<>|:;,()\[\]{}*?]"
PATHS = re.compile(rf"(?:file://|(?<![\w./~*:])|(?<=\w:)(?!//))/(?:{_PIECE}+/)+({_PIECE}*)")


def secrets_of(environment: Mapping[str, str]) -> tuple[str, ...]:
    """Return the values of the environment variables that hold API keys, according to their names."""
    plain = keyless_environment(environment)
    return worth_hiding(*(value for name, value in environment.items() if name not in plain))


class Scrubber:
    """Removes secrets, text that looks like a key, and the folders of absolute paths (file names stay)."""

    def __init__(self, secrets: Sequence[str] = (), folders: Sequence[PurePosixPath] = ()) -> None:
        self._secrets = tuple(secrets)
        longest_first = sorted({str(folder) for folder in folders if len(folder.parts) > 1}, key=len, reverse=True)
        self._folders = tuple(longest_first)

    def text(self, text: str) -> str:
        text = KEYS.sub(HIDDEN, redacted(text, *self._secrets))
        for folder in self._folders:  # before PATHS, because names of these folders may have blanks
            text = text.replace(f"{folder}/", "").replace(folder, PurePosixPath(folder).name)
        return PATHS.sub(r"\1", text)

    def lines(self, data: bytes) -> bytes:
        """Return scrubbed JSON lines. A line without a match is unchanged."""
        return b"\n".join(self._line(line, lambda value: json.dumps(value)) for line in data.split(b"\n"))

    def document(self, data: bytes) -> bytes:
        """Return a scrubbed JSON document. A document without a match is unchanged."""
        return self._line(data, lambda value: json.dumps(value, indent=2, ensure_ascii=False) + "\n")

    def _line(self, line: bytes, written: Callable[[Any], str]) -> bytes:
        text = line.decode("utf-8", "surrogateescape")
        if not self._may_hold_secret(text):
            return line
        try:
            value = json.loads(text)
            clean = self._value(value)
        except (ValueError, RecursionError):  # truncated or invalid JSON: scrub it as text
            return self.text(text).encode("utf-8", "surrogateescape")
        if clean == value:
            return line
        return hide_secrets(written(clean), *self._secrets).encode("utf-8", "backslashreplace")

    def _may_hold_secret(self, text: str) -> bool:
        return "/" in text or bool(KEYS.search(text)) or hide_secrets(text, *self._secrets) != text

    def _value(self, value: Any) -> Any:
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, list):
            return [self._value(item) for item in value]
        if isinstance(value, dict):
            return {self.text(key): self._value(item) for key, item in value.items()}
        return value


RUNS_MAX = 99


@dataclass(slots=True)
class _Contents:
    """The files of an archive and the omitted files, by name."""

    files: dict[str, Callable[[], bytes]] = field(default_factory=dict)
    digests: dict[str, FileDigest] = field(default_factory=dict)
    left_out: dict[str, FileDigest] = field(default_factory=dict)
    scrubbed: list[str] = field(default_factory=list)

    def add(self, name: str, path: Path, clean: Callable[[bytes], bytes]) -> None:
        """Add a file with the contents that `clean` returns."""
        raw = path.read_bytes()
        data = clean(raw)
        if data != raw:
            self.scrubbed.append(name)
        self.files[name] = lambda: clean(path.read_bytes())  # read again, to save memory
        self.digests[name] = digest(data)


def submit(
    runs: Sequence[RecordedRun],
    out: Path,
    *,
    name: str | None = None,
    note: str = "",
    partial: bool = False,
    with_frames: bool = False,
    secrets: Sequence[str] = (),
) -> Manifest:
    """Write the archive of some runs and return its manifest. Equal runs give equal archives.

    Raises UsageError if the runs have several pilots or settings, if the suite is incomplete or not fully scored
    (unless `partial`), or if the archive cannot be written.
    """
    ordered = sorted(runs, key=lambda run: (run.seed, str(run.folder)))
    _check_one_entry(ordered)
    flights = [[episode.name for episode in run.episodes] for run in ordered]
    missing = incompleteness_reason(flights)
    fault = missing or next(filter(None, map(_unscored, ordered)), None)
    if fault and not partial:
        raise UsageError(f"{fault}. To submit it anyway, marked as partial: --partial")
    scrubber = Scrubber(secrets, list(_machine_folders(ordered)))
    try:
        contents = _contents(ordered, scrubber, with_frames)
        manifest = Manifest(
            schema=SCHEMA,
            name=_clean_text("--name", name or ordered[0].pilot, NAME_CHARS, scrubber),
            note=_clean_text("--note", note, NOTE_CHARS, scrubber),
            pilot=scrubber.text(ordered[0].pilot),
            is_model=ordered[0].is_model,
            identity=identity_digest(_as_packed(ordered[0], scrubber)),
            suite=common_suite(flights),
            partial=scrubber.text(fault) if fault else None,
            runs=tuple(
                SubmittedRun(folder=_place(k), seed=run.seed, episodes=tuple(ids))
                for k, (run, ids) in enumerate(zip(ordered, flights, strict=True))
            ),
            files=contents.digests,
            left_out=contents.left_out,
            scrubbed=tuple(contents.scrubbed),
            dronecats=__version__,
        )
        with whole_file(out) as draft:
            write(draft, [(MANIFEST, manifest.encoded), *contents.files.items()])
    except OSError as error:
        raise UsageError(f"{error.filename or out} cannot be read or written: {error.strerror}") from None
    return manifest


def digest(data: bytes) -> FileDigest:
    return FileDigest(bytes=len(data), sha256=hashlib.sha256(data).hexdigest())


def incompleteness_reason(flights: Sequence[Sequence[str]]) -> str | None:
    """Return a sentence that says why the runs do not all have exactly the episodes of one suite; None: they have.

    `flights`: the episode ids of each run.
    """
    for ids in flights:
        own = [id for id in ids if id not in catalogue.all_ids()]
        if own:
            return f"{own[0]} is not a shipped episode"
        if suite_of(ids) is None:
            containing = (s for s in catalogue.SUITES if set(ids) <= set(catalogue.suite_ids(s)))
            nearest = min(containing, key=_size, default=None)
            if nearest is None:
                return "the episodes are of several suites"
            absent = [id for id in catalogue.suite_ids(nearest) if id not in ids]
            return f"{len(absent)} of the {_size(nearest)} episodes of suite {nearest} are missing, {absent[0]} first"
    return None if len({suite_of(ids) for ids in flights}) == 1 else "the flights are of several suites"


def _size(suite: str) -> int:
    return len(catalogue.suite_ids(suite))


def suite_of(ids: Sequence[str]) -> str | None:
    """Return the suite that has exactly these episodes; None: no such suite."""
    return next((suite for suite in catalogue.SUITES if sorted(ids) == catalogue.suite_ids(suite)), None)


def common_suite(flights: Sequence[Sequence[str]]) -> str | None:
    """Return the suite of which every run has all episodes, and no other episodes; None: no such suite.

    `flights`: the episode ids of each run.
    """
    of_each = {suite_of(ids) for ids in flights}
    return of_each.pop() if len(of_each) == 1 else None


def _check_one_entry(runs: Sequence[RecordedRun]) -> None:
    first = runs[0]
    if len(runs) > RUNS_MAX:
        raise UsageError(f"{len(runs)} runs are more than the limit of an archive, {RUNS_MAX}. Submit fewer")
    for run in runs:
        if not run.flight:
            raise UsageError(f"{run.folder / layout.RUN} does not have the flight, so its pilot is unknown")
        if run.flight.get("replay") is not None:
            raise UsageError(f"{run.folder} is a replay of a recorded flight, which cannot be an entry")
        if stray := next((e.name for e in run.episodes if not EPISODE_NAME.fullmatch(e.name)), None):
            raise UsageError(f"{run.folder / stray} does not have the name of an episode")
    for run in runs[1:]:
        if differing := differences(identity(first), identity(run)):
            raise UsageError(
                f"{run.folder.name} differs from {first.folder.name} in {', '.join(map(str, differing))}; an entry"
                " has the flights of one pilot with one configuration. Submit each by itself"
            )
    seeds = [run.seed for run in runs]
    if twice := [seed for seed in seeds if seeds.count(seed) > 1]:
        raise UsageError(f"several runs have the seed {twice[0]}, but the flights of an entry need different seeds")


def _as_packed(run: RecordedRun, scrubber: Scrubber) -> Identity:
    """Return the identity (settings) of a run, as a reader of the scrubbed files will compute it."""
    clean = json.loads(scrubber.document(json.dumps(run.configuration).encode()))
    values = identity(replace(run, configuration=clean))
    return {name: frozenset(map(scrubber.text, entries)) for name, entries in values.items()}


def _unscored(run: RecordedRun) -> str | None:
    for folder in run.episodes:
        verdict = verdict_of(folder)
        if verdict.outcome not in SCORED:
            reason = verdict.error or f"its outcome is {verdict.outcome}"
            return f"{folder.name} of {run.folder.name} is not scored: {reason}"
    return None


def _contents(runs: Sequence[RecordedRun], scrubber: Scrubber, with_frames: bool) -> _Contents:
    contents = _Contents()
    for k, run in enumerate(runs):
        contents.add(f"{_place(k)}/{layout.RUN}", run.folder / layout.RUN, scrubber.document)
        for episode in run.episodes:
            place = f"{_place(k)}/{episode.name}"
            for log in (log for log in LOGS if (episode / log).is_file()):
                clean = scrubber.lines if log.endswith(".jsonl") else scrubber.document
                contents.add(f"{place}/{log}", episode / log, clean)
            pictures = sorted((episode / layout.FRAMES).glob("*.jpg"))
            if with_frames:
                for picture in pictures:
                    contents.add(f"{place}/{layout.FRAMES}/{picture.name}", picture, lambda data: data)
            elif pictures:
                contents.left_out[f"{place}/{layout.FRAMES}/"] = _folder_digest(pictures)
            if (episode / layout.TLOG).is_file():
                contents.left_out[f"{place}/{layout.TLOG}"] = digest((episode / layout.TLOG).read_bytes())
    return contents


def _folder_digest(files: Sequence[Path]) -> FileDigest:
    digests = {file.name: digest(file.read_bytes()) for file in files}
    listing = "".join(f"{entry.sha256}  {name}\n" for name, entry in digests.items())
    size = sum(entry.bytes for entry in digests.values())
    return FileDigest(bytes=size, sha256=digest(listing.encode()).sha256, files=len(digests))


def _place(k: int) -> str:
    return f"runs/{k + 1:02}"


def _machine_folders(runs: Sequence[RecordedRun]) -> Iterator[PurePosixPath]:
    """Yield the folders of this machine that are likely to occur in paths in the logs."""
    yield PurePosixPath(os.getcwd())
    with suppress(RuntimeError):  # the user has no home folder
        yield PurePosixPath(Path.home())
    for run in runs:
        yield PurePosixPath(run.folder)
        yield PurePosixPath(run.folder.parent)


def _clean_text(option: str, text: str, most: int, scrubber: Scrubber) -> str:
    clean = scrubber.text(" ".join(text.split()))
    if len(clean) > most or not clean.isprintable():
        raise UsageError(f"{option} must be printable text of at most {most} characters")
    return clean
