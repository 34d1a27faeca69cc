import pytest

from tests.autopilot.commander_bench import Bench


@pytest.fixture
def bench() -> Bench:
    """A vehicle on the ground, ready to arm, and a client with few telemetry streams."""
    return Bench(profile="minimal")
