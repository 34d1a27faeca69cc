"""VerdictWatch ends a flight. It reads the logs only while a declaration is open, and for a limited time."""

import json

import pytest

from dronecats.flight.run.episode import VerdictWatch
from foundation.errors import UsageError
from tests.judge.episode_logs import BEGIN, decision, frame, logs, write

GO = decision(0, 0, 2.0, action="go")
EARLY = decision(1, 1, 5.0)
LATE = decision(3, 2, 9.0)


def made(row):
    return logs([row]).decisions[0]


def test_a_declaration_that_does_not_qualify_is_checked_once(tmp_path):
    folder = write(tmp_path / "run" / "e", [GO, EARLY], [BEGIN, frame(0, 1.5, 20.0), frame(1, 4.5, 9.0)])
    watch = VerdictWatch(folder, full=False)
    assert not watch.decided(made(EARLY))
    (folder / "truth.jsonl").unlink()
    assert not watch.decided(made(GO))  # no declaration is open, so the files are not read
    with pytest.raises(UsageError):
        watch.decided(made(LATE))


def test_a_declaration_whose_picture_is_measured_later_stays_open(tmp_path):
    folder = write(tmp_path / "run" / "e", [GO, EARLY], [BEGIN, frame(0, 1.5, 20.0)])
    watch = VerdictWatch(folder, full=False)
    assert not watch.decided(made(EARLY))
    with (folder / "truth.jsonl").open("a") as log:
        log.write(json.dumps(frame(1, 4.5, 3.0)) + "\n")
    assert watch.decided(made(GO))
    assert watch.success


def test_a_full_flight_is_never_decided_before_its_cap(tmp_path):
    folder = write(tmp_path / "run" / "e", [EARLY], [BEGIN, frame(1, 4.5, 3.0)])
    assert not VerdictWatch(folder, full=True).decided(made(EARLY))
    assert VerdictWatch(folder, full=False).decided(made(EARLY))
