"""How the scripts end: one sentence on standard error, and the status that a command would have."""

import sys

import pytest

from examples.action_head import script, serve
from foundation.errors import InfrastructureError, UsageError


def ending(fault):
    def main():
        raise fault

    return main


@pytest.mark.parametrize(
    ("fault", "status"),
    [(UsageError("no such thing"), 2), (InfrastructureError("it broke"), 3)],
    ids=["usage", "broke"],
)
def test_a_fault_is_one_sentence(fault, status, capsys):
    assert script.ended(ending(fault)) == status
    assert capsys.readouterr().err == f"action_head: {fault}\n"


def test_an_interrupt_says_nothing(capsys):
    assert script.ended(ending(KeyboardInterrupt())) == 130
    assert capsys.readouterr().err == ""


def test_without_pytorch_it_is_told_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)  # as where it is not installed
    assert script.ended(lambda: serve.main(["head.pt"])) == 2
    assert "pip install -e '.[train]'" in capsys.readouterr().err


def test_another_missing_module_is_a_mistake_of_ours():
    with pytest.raises(ModuleNotFoundError):
        script.ended(ending(ModuleNotFoundError("no numpy", name="numpy")))


def test_where_no_folder_can_be_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be made a folder"):
        script.make_folder(tmp_path / "file" / "out")
