"""Errors of the example's scripts without PyTorch."""

import sys

from dronecats.cli.exit_status import exit_status
from examples.action_head import serve


def test_without_pytorch_the_error_names_the_package(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)  # as if PyTorch were not installed
    assert exit_status("action_head", lambda: serve.main(["head.pt"])) == 2
    assert "dronecats[train]" in capsys.readouterr().err
