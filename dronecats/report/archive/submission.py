"""From run folders to an archive: the flights of one pilot under one configuration, whole or marked as partial."""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

from dronecats import __version__
from dronecats.judge.episode import judge_run
from dronecats.report.archive.manifest import (
    EPISODE_NAME,
    LOGS,
    MANIFEST,
    NAME_CHARS,
    NOTE_CHARS,
    SCHEMA,
    FileDigest,
    Manifest,
    SubmittedRun,
)
from dronecats.report.archive.scrubbing import Scrubber
from dronecats.report.archive.tar import write
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.identity import Identity, differences, identity, identity_digest
from episodes.records import catalogue
from foundation.errors import UsageError
from foundation.files import whole_file
from foundation.run_folder import layout
from foundation.run_folder.results import SCORED

RUNS_MAX = 99


@dataclass(slots=True)
class _Contents:
    """What goes into the archive, by name, and what does not."""

    files: dict[str, Callable[[], bytes]] = field(default_factory=dict)
    digests: dict[str, FileDigest] = field(default_factory=dict)
    left_out: dict[str, FileDigest] = field(default_factory=dict)
    scrubbed: list[str] = field(default_factory=list)

    def add(self, name: str, path: Path, clean: Callable[[bytes], bytes]) -> None:
        """Take a file in, as `clean` leaves it."""
        raw = path.read_bytes()
        data = clean(raw)
        if data != raw:
            self.scrubbed.append(name)
        self.files[name] = lambda: clean(path.read_bytes())  # a thousand episodes are not kept in memory
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
    """Write the archive of some runs and return what it says of itself. The same runs are the same bytes.

    Raises UsageError when the runs are of several pilots or settings, when a suite is not whole or not scored (unless
    `partial`), and when it cannot be written.
    """
    ordered = sorted(runs, key=lambda run: (run.seed, str(run.folder)))
    _must_be_one_entry(ordered)
    suite = _suite(ordered)
    missing = incomplete([[episode.name for episode in run.episodes] for run in ordered])
    fault = missing or next(filter(None, map(_unscored, ordered)), None)
    if fault and not partial:
        raise UsageError(f"{fault}; --partial submits it all the same, marked as such")
    scrubber = Scrubber(secrets, _folders(ordered))
    try:
        contents = _contents(ordered, scrubber, with_frames)
        manifest = Manifest(
            schema=SCHEMA,
            name=_said("--name", name or ordered[0].pilot, NAME_CHARS, scrubber),
            note=_said("--note", note, NOTE_CHARS, scrubber),
            pilot=scrubber.text(ordered[0].pilot),
            is_model=ordered[0].is_model,
            identity=identity_digest(_as_packed(ordered[0], scrubber)),
            suite=suite,
            partial=scrubber.text(fault) if fault else None,
            runs=tuple(
                SubmittedRun(folder=_place(k), seed=run.seed, episodes=tuple(e.name for e in run.episodes))
                for k, run in enumerate(ordered)
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
    """Return the digest of a file's bytes."""
    return FileDigest(bytes=len(data), sha256=hashlib.sha256(data).hexdigest())


def incomplete(flights: Sequence[Sequence[str]]) -> str | None:
    """Return what keeps flights, the ids of each, from being of one whole suite, a sentence; None: they are."""
    for ids in flights:
        own = [id for id in ids if id not in catalogue.all_ids()]
        if own:
            return f"{own[0]} is no episode that ships"
        if _suite_of(ids) is None:
            containing = (s for s in catalogue.SUITES if set(ids) <= set(catalogue.suite_ids(s)))
            nearest = min(containing, key=_size, default=None)
            if nearest is None:
                return "the episodes are of several suites"
            absent = [id for id in catalogue.suite_ids(nearest) if id not in ids]
            return f"{len(absent)} of the {_size(nearest)} episodes of suite {nearest} are missing, {absent[0]} first"
    return None if len({_suite_of(ids) for ids in flights}) == 1 else "the flights are of several suites"


def _size(suite: str) -> int:
    return len(catalogue.suite_ids(suite))


def _suite_of(ids: Sequence[str]) -> str | None:
    return next((suite for suite in catalogue.SUITES if sorted(ids) == catalogue.suite_ids(suite)), None)


def _suite(runs: Sequence[RecordedRun]) -> str | None:
    of_each = {_suite_of([episode.name for episode in run.episodes]) for run in runs}
    return of_each.pop() if len(of_each) == 1 else None


def _must_be_one_entry(runs: Sequence[RecordedRun]) -> None:
    first = runs[0]
    if len(runs) > RUNS_MAX:
        raise UsageError(f"{len(runs)} runs are more than an archive holds, {RUNS_MAX}")
    for run in runs:
        if not run.flight:
            raise UsageError(f"{run.folder / layout.RUN} does not say what was flown, so nobody can tell whose it is")
        if run.flight.get("replay") is not None:
            raise UsageError(f"{run.folder} is a recording that was flown again, and nobody's entry")
        if stray := next((e.name for e in run.episodes if not EPISODE_NAME.fullmatch(e.name)), None):
            raise UsageError(f"{run.folder / stray} has a name that no episode has")
    for run in runs[1:]:
        if differing := differences(identity(first), identity(run)):
            raise UsageError(
                f"{run.folder.name} differs from {first.folder.name} in {', '.join(map(str, differing))}; an entry is"
                " the flights of one pilot under one configuration, so submit each by itself"
            )
    seeds = [run.seed for run in runs]
    if twice := [seed for seed in seeds if seeds.count(seed) > 1]:
        raise UsageError(f"several runs have the seed {twice[0]}; flights of one entry differ in it")


def _as_packed(run: RecordedRun, scrubber: Scrubber) -> Identity:
    """Return a run's identity as its files in the archive tell it."""
    clean = json.loads(scrubber.document(_json(run.configuration)))
    told = identity(replace(run, configuration=clean))
    return {what: frozenset(map(scrubber.text, values)) for what, values in told.items()}


def _unscored(run: RecordedRun) -> str | None:
    for episode, judged in judge_run(run.folder).items():
        if judged.verdict.outcome not in SCORED and any(episode == each.name for each in run.episodes):
            said = judged.verdict.error or f"its outcome is {judged.verdict.outcome}"
            return f"{episode} of {run.folder.name} is nobody's score: {said}"
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
                contents.left_out[f"{place}/{layout.FRAMES}/"] = _of_folder(pictures)
            if (episode / layout.TLOG).is_file():
                contents.left_out[f"{place}/{layout.TLOG}"] = digest((episode / layout.TLOG).read_bytes())
    return contents


def _of_folder(files: Sequence[Path]) -> FileDigest:
    each = [(file.name, digest(file.read_bytes())) for file in files]
    told = "".join(f"{of.sha256}  {name}\n" for name, of in each)
    return FileDigest(bytes=sum(of.bytes for _, of in each), sha256=digest(told.encode()).sha256, files=len(each))


def _place(k: int) -> str:
    return f"runs/{k + 1:02}"


def _json(value: Any) -> bytes:
    return (json.dumps(value) + "\n").encode()


def _folders(runs: Sequence[RecordedRun]) -> list[PurePosixPath]:
    """Return the folders of this machine by which its paths are likely to begin."""
    return list(_each_folder(runs))


def _each_folder(runs: Sequence[RecordedRun]) -> Iterator[PurePosixPath]:
    yield PurePosixPath(os.getcwd())
    with suppress(RuntimeError):  # a user id that has no home
        yield PurePosixPath(Path.home())
    for run in runs:
        yield PurePosixPath(run.folder)
        yield PurePosixPath(run.folder.parent)


def _said(option: str, text: str, most: int, scrubber: Scrubber) -> str:
    clean = scrubber.text(" ".join(text.split()))
    if len(clean) > most or not clean.isprintable():
        raise UsageError(f"{option} wants printable text of at most {most} letters")
    return clean
