"""The message of the error that a call raises."""

from collections.abc import Callable
from typing import Any

import pytest

from foundation.errors import UsageError


def refusal(call: Callable[..., Any], *arguments: Any, error: type[Exception] = UsageError, **keywords: Any) -> str:
    """Return the message of the `error` that a call raises; the test fails when the call raises none."""
    try:
        call(*arguments, **keywords)
    except error as raised:
        return str(raised)
    pytest.fail(f"{call.__name__}{arguments!r} {keywords!r} raises no {error.__name__}")
