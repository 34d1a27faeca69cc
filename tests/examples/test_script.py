"""The example's scripts without PyTorch, and without a folder to write into."""

import sys

import pytest

from dronecats.cli.exit_status import exit_status
from examples.action_head import script, serve
from foundation.errors import UsageError


def test_without_pytorch_the_error_names_the_package(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)  # as without an installed PyTorch
    assert exit_status("action_head", lambda: serve.main(["head.pt"])) == 2
    assert "dronecats[train]" in capsys.readouterr().err


def test_an_impossible_folder_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="file/out"):
        script.make_folder(tmp_path / "file" / "out")
