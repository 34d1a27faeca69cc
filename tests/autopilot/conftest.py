import pytest

from tests.autopilot.commander_bench import Bench


@pytest.fixture
def bench() -> Bench:
    """A vehicle on the ground, ready to arm, and a client of few streams."""
    return Bench(profile="minimal")
