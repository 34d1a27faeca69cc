"""Values cached on disk. They are computed again if a source file changes or the cache file is damaged."""

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from foundation import kept_values
from foundation.kept_values import kept


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Return a function that requests a value, and the list of computations so far."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(kept_values, "ROOT", tmp_path)
    (tmp_path / "source.py").write_text("a = 1")
    made_numbers: list[int] = []

    def make():
        made_numbers.append(len(made_numbers))
        return {"value": np.arange(3) + made_numbers[-1]}

    return lambda: kept("thing", ["*.py"], make)["value"].tolist(), made_numbers


def files(tmp_path):
    return sorted((tmp_path / "cache" / "dronecats" / "values").iterdir())


def test_a_value_is_computed_once(made, tmp_path):
    ask, made_numbers = made
    assert ask() == ask() == [0, 1, 2]
    assert made_numbers == [0]
    assert len(files(tmp_path)) == 1


def test_a_changed_source_file_causes_a_new_computation(made, tmp_path):
    ask, _ = made
    ask()
    (tmp_path / "source.py").write_text("a = 2")
    assert ask() == [1, 2, 3]
    (tmp_path / "source.py").write_text("a = 1")
    assert ask() == [0, 1, 2]


def test_each_input_has_a_value_of_its_own_and_the_oldest_files_go(made, tmp_path, monkeypatch):
    del made
    monkeypatch.setattr(kept_values, "FILES_MAX", 2)
    for number in (1, 2, 1, 3):
        assert kept("square", ["*.py"], partial(pow, number, 2), number) == number**2
        for file in files(tmp_path):  # the clock of the file system may be coarse
            os.utime(file, (file.stat().st_atime, file.stat().st_mtime - 10.0))
    assert len(files(tmp_path)) == 2
    assert kept("square", ["*.py"], lambda: 0, 1) == 1  # 2 was unused for longest


def test_storing_a_value_removes_files_that_were_unused_for_a_week(made, tmp_path):
    del made
    for number, age_s in ((1, 8 * 86_400.0), (2, 6 * 86_400.0)):
        before = set(files(tmp_path)) if number > 1 else set()
        kept("square", ["*.py"], partial(pow, number, 2), number)
        (stored,) = set(files(tmp_path)) - before
        os.utime(stored, (stored.stat().st_atime, stored.stat().st_mtime - age_s))
    kept("square", ["*.py"], partial(pow, 3, 2), 3)
    assert kept("square", ["*.py"], lambda: 0, 2) == 4
    assert kept("square", ["*.py"], lambda: 0, 1) == 0


@pytest.mark.parametrize("data", [b"", b"no pickle", "half"])
def test_a_damaged_cache_file_is_replaced(made, tmp_path, data):
    ask, _ = made
    ask()
    (file,) = files(tmp_path)
    file.write_bytes(file.read_bytes()[:60] if data == "half" else data)
    assert ask() == ask() == [1, 2, 3]


def test_without_a_writable_cache_folder_values_are_computed_each_time(made, tmp_path):
    ask, made_numbers = made
    (tmp_path / "cache").write_text("a file where the folder should be")
    ask(), ask()
    assert made_numbers == [0, 1]


def test_a_read_only_cache_folder_is_used(made, monkeypatch):
    ask, made_numbers = made
    ask()

    def refuse(path):
        raise PermissionError(path)

    monkeypatch.setattr(os, "utime", refuse)
    ask()
    assert made_numbers == [0]


def test_a_failed_write_leaves_no_file(made, tmp_path, monkeypatch):
    ask, made_numbers = made

    def is_full(path, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", is_full)
    ask(), ask()
    assert made_numbers == [0, 1]
    assert files(tmp_path) == []
