"""`file_errors_as` turns errors of the operating system into sentences."""

import pytest

from foundation.errors import InfrastructureError, UsageError
from foundation.files import file_errors_as


def test_an_os_error_becomes_a_sentence_with_reason_and_advice(tmp_path):
    with (
        pytest.raises(UsageError, match=r"^the file cannot be read: No such file or directory\. Name another$"),
        file_errors_as(UsageError, "the file cannot be read", ". Name another"),
    ):
        (tmp_path / "missing").read_bytes()


def test_an_error_without_a_reason_keeps_its_text_and_other_errors_pass():
    with pytest.raises(InfrastructureError, match=r"^x: full$"), file_errors_as(InfrastructureError, "x"):
        raise OSError("full")
    with pytest.raises(ValueError, match="other"), file_errors_as(UsageError, "x"):
        raise ValueError("other")
