"""Tests that the outputs of film, replay, export and report for flights of an older version do not change."""

import json

import pytest

from tests.report.recorded.kept import OUTPUTS, outputs, unpacked

MOVED = 2e-6  # tolerance in m, rad, s: the last stored digit


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kept")
    return outputs(unpacked(folder), folder / "out")


@pytest.mark.parametrize("part", json.loads(OUTPUTS.read_text()))
def test_the_outputs_of_a_stored_flight_do_not_change(made, part):
    differing = list(differences(json.loads(OUTPUTS.read_text())[part], made[part], part))
    assert differing == []


def differences(kept, now, where):
    """Yield each place where two JSON values differ, numbers by more than MOVED."""
    if isinstance(kept, dict) and isinstance(now, dict) and kept.keys() == now.keys():
        for key in kept:
            yield from differences(kept[key], now[key], f"{where}/{key}")
    elif isinstance(kept, list) and isinstance(now, list) and len(kept) == len(now):
        for index, pair in enumerate(zip(kept, now, strict=True)):
            yield from differences(*pair, f"{where}/{index}")
    elif isinstance(kept, float) and isinstance(now, float):
        if abs(kept - now) > MOVED:
            yield where, kept, now
    elif kept != now:
        yield where, kept, now
