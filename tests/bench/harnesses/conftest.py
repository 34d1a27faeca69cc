"""Shared by the tests of harnesses: flights that end before they begin."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from foundation.errors import UsageError


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch) -> Callable[[ModuleType], list[tuple[str, Path]]]:
    """Make a harness refuse its flights. Returns the list that will have the (episode, run folder) of each flight."""

    def refuse(harness: ModuleType) -> list[tuple[str, Path]]:
        runs: list[tuple[str, Path]] = []

        def begin(spec, run):
            runs.append((spec.episode, run))
            raise UsageError("no flight is needed")

        monkeypatch.setattr(harness, "OutsideFlight", begin)
        return runs

    return refuse
