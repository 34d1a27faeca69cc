"""A commanding episode flies with the requested number of drones. Its folder holds the adapted record."""

import pytest

from dronecats.cli.main import main
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from episodes.records import catalogue, record
from episodes.records.formation import with_drones
from tests.support.json_lines import rows

EPISODE = "blocks-commanding-01"


@pytest.mark.parametrize("drones", [1, 2, pytest.param(6, marks=pytest.mark.slow)])
def test_the_requested_number_of_drones_flies_and_is_recorded(tmp_path, drones):
    spec = FlightSpec(
        pilot="oracle", episode=EPISODE, drones=drones, simulated=Simulated(speed=None, rendered=False), seconds=4.0
    )
    fly(spec, tmp_path / "run", lambda line: None)
    folder = tmp_path / "run" / EPISODE
    assert record.load(folder / "episode.json") == with_drones(catalogue.load(EPISODE), drones)
    for log in ("decisions.jsonl", "truth.jsonl"):
        assert {row["drone"] for row in rows(folder / log) if "drone" in row} == set(range(drones))
    starts = with_drones(catalogue.load(EPISODE), drones).starts
    first = {p["drone"]: p["position_ned"] for p in reversed(rows(folder / "truth.jsonl")) if p["kind"] == "pose"}
    for drone, start in enumerate(starts):
        assert first[drone] == pytest.approx(start.position_ned, abs=0.5)


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (("--sitl", "--episode", "campus-approaching-01", "--drones", "2"), "campus-approaching-01"),
        (("--sitl", "--episode", EPISODE, "--drones", "9"), "--drones"),
        (("--connect", "udpin://127.0.0.1:1", "--drones", "2"), "--sitl"),
    ],
)
def test_invalid_drone_counts_end_with_one_sentence(words, word, tmp_path, capsys):
    assert main(["fly", *words, "--pilot", "oracle", "--out", str(tmp_path / "run")]) == 2
    assert word in capsys.readouterr().err
