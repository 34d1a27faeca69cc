"""Errors of the example's scripts: PyTorch is missing, or the output folder cannot be created."""

import sys

import pytest

from dronecats.cli.exit_status import exit_status
from examples.action_head import script, serve
from foundation.errors import UsageError


def test_without_pytorch_the_error_names_the_package(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)  # as if PyTorch were not installed
    assert exit_status("action_head", lambda: serve.main(["head.pt"])) == 2
    assert "dronecats[train]" in capsys.readouterr().err


def test_an_output_folder_that_cannot_be_created_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="file/out"):
        script.make_folder(tmp_path / "file" / "out")
