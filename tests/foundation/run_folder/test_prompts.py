"""prompts.jsonl: the reader restores the written prompts, with and without common lines."""

import json
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.prompts import read_prompts
from foundation.run_folder.writing import PromptLog
from tests.foundation.run_folder.published import check

LINES = st.lists(st.sampled_from(["", "a", "b", "a b"]), max_size=6).map("\n".join)


def write(folder, questions):
    log = PromptLog(folder / layout.PROMPTS)
    for number, (role, text) in enumerate(questions):
        log.write(role, 0, number, 0.5 * number, [number], (), text)
    log.close()


@given(st.lists(st.tuples(st.sampled_from(["pilot", "commander"]), LINES | st.text()), max_size=8))
def test_written_prompts_are_read_back_unchanged(questions):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(folder, questions)
        read = read_prompts(folder)
        assert [(each.row.role, each.text) for each in read] == questions
        assert [each.row.frames for each in read] == [(number,) for number in range(len(questions))]
        assert check(folder / layout.PROMPTS) == len(questions)


def test_a_folder_without_a_prompt_file_has_no_prompts(tmp_path):
    assert read_prompts(tmp_path) == ()


def test_a_line_without_its_base_line_is_reported_as_damage(tmp_path):
    text = "\n".join("abcdefgh")
    write(tmp_path, [("pilot", text), ("pilot", text.replace("d", "x"))])
    path = tmp_path / layout.PROMPTS
    _, second = path.read_text().splitlines()
    assert json.loads(second)["lines"] == ["x"]
    path.write_text(second + "\n")
    with pytest.raises(UsageError, match=r"prompts\.jsonl"):
        read_prompts(tmp_path)


def test_an_incomplete_last_line_is_ignored(tmp_path):
    write(tmp_path, [("pilot", "find it"), ("pilot", "find the other")])
    path = tmp_path / layout.PROMPTS
    path.write_text(path.read_text()[:-9])
    assert [each.text for each in read_prompts(tmp_path)] == ["find it"]


def test_prompts_of_drones_with_different_goals_are_compressed_separately(tmp_path):
    log = PromptLog(tmp_path / layout.PROMPTS)
    for number in range(4):
        for drone, goal in enumerate(("find the van", "find the bench")):
            text = "\n".join([goal, *(f"rule {k}" for k in range(50)), f"step {number}", "answer"])
            log.write("pilot", drone, number, float(number), [number], (), text)
    log.close()
    lengths = [len(line) for line in (tmp_path / layout.PROMPTS).read_text().splitlines()]
    assert max(lengths[2:]) < min(lengths[:2]) / 2
    assert [each.text.splitlines()[0] for each in read_prompts(tmp_path)] == ["find the van", "find the bench"] * 4
