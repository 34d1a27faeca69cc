"""A file is replaced atomically: it has the old or the new contents, and no draft remains."""

import pytest

from foundation.files import whole_file, write_text


def break_off(path):
    with whole_file(path) as draft:
        draft.write_text("half of the n")
        raise KeyboardInterrupt


def test_an_interrupted_write_leaves_the_old_file_and_no_draft(tmp_path):
    path = tmp_path / "table.csv"
    write_text(path, "old\n")
    with pytest.raises(KeyboardInterrupt):
        break_off(path)
    assert [each.name for each in tmp_path.iterdir()] == ["table.csv"]
    assert path.read_text() == "old\n"


def test_the_new_file_replaces_the_old_one(tmp_path):
    path = tmp_path / "table.csv"
    write_text(path, "old\n")
    with whole_file(path) as draft:
        draft.write_text("new\n")
    assert [each.read_text() for each in tmp_path.iterdir()] == ["new\n"]


def test_a_missing_folder_raises_file_not_found_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        write_text(tmp_path / "nowhere" / "table.csv", "new\n")
