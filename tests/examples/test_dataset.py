"""Compares a dataset, read as arrays, with the logs of its flights."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from dronecats.agent.action import Finished, Go, Rotate, Think, action_from
from dronecats.cli.main import main
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.pilots.actions import PastAction
from examples.action_head import dataset, features
from examples.action_head.dataset import action_of
from examples.action_head.features import KINDS
from foundation.errors import UsageError
from tests.examples.conftest import EPISODES

pytestmark = pytest.mark.slow  # two flights with rendered frames


def decided(run_folder):
    """Yield (episode, row of decisions.jsonl) for every decision, in the order of the dataset."""
    for episode in EPISODES:
        for line in (run_folder / episode / "decisions.jsonl").read_text().splitlines():
            yield episode, json.loads(line)


def test_the_dataset_holds_every_decision_with_its_inputs(run_folder, dataset_folder):
    data, logged = dataset.read(dataset_folder), list(decided(run_folder))
    assert len(data) == len(logged)
    past: list[PastAction] = []
    for k, (episode, row) in enumerate(logged):
        if k and episode != logged[k - 1][0]:
            past = []
        action = action_from(row["action"])
        assert KINDS[data.kinds[k]] == row["action"]["action"]
        assert data.past[0, k] == pytest.approx(features.history(past[-5:]), abs=1e-6)
        assert data.past[1, k] == pytest.approx(features.history(past[-5:], mirrored=True), abs=1e-6)
        record = json.loads((run_folder / episode / "episode.json").read_text())
        np.testing.assert_array_equal(data.words[0, k], features.words(record["instruction"]))
        if isinstance(action, Go):
            np.testing.assert_allclose(data.points[k] * 1000.0, (action.x, action.y), rtol=1e-5)
            assert data.depths_m[k] == pytest.approx(action.depth_m)
        if isinstance(action, Rotate):
            assert data.angles_deg[k] == pytest.approx(action.angle_deg)
        past.append(features.as_past(action))
    assert {KINDS[kind] for kind in data.kinds} == {"go", "rotate", "finished"}  # the flights must show all three


def test_the_dataset_holds_the_pictures_that_the_pilot_saw(run_folder, dataset_folder):
    data = dataset.read(dataset_folder)
    frames = [frame for episode in EPISODES for frame in sorted((run_folder / episode / "frames").iterdir())]
    for shown, frame in zip(data.pictures, frames, strict=True):
        np.testing.assert_array_equal(shown, features.picture(frame.read_bytes()))


def test_flights_without_rendered_pictures_are_rejected(tmp_path):
    """Lockstep writes blank pictures for pilots that do not use them. A head can learn only turns from them."""
    unrendered, folder = tmp_path / "flown", tmp_path / "dataset"
    blank = FlightSpec(episode=EPISODES[0], pilot="oracle", simulated=Simulated(speed=None, rendered=False))
    assert fly(blank, unrendered, lambda _: None)["success"]
    assert main(["export", str(unrendered), "--to", "lerobot", "--out", str(folder)]) == 0
    with pytest.raises(UsageError, match="--rendered"):
        dataset.read(folder)


def test_a_dataset_of_failed_flights_is_rejected(dataset_folder, tmp_path):
    folder = tmp_path / "failed"
    shutil.copytree(dataset_folder, folder)
    (file,) = (folder / "data").rglob("*.parquet")
    table = pq.read_table(file)
    place = table.column_names.index("judge.success")
    pq.write_table(table.set_column(place, table.schema.field(place), [[False] * len(table)]), file)
    with pytest.raises(UsageError, match="successful"):
        dataset.read(folder)


def test_invalid_datasets_are_reported(dataset_folder, tmp_path):
    with pytest.raises(UsageError, match="dronecats export"):
        dataset.read(tmp_path)
    folder = tmp_path / "broken"
    shutil.copytree(dataset_folder, folder)
    (file,) = (folder / "data").rglob("*.parquet")
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(UsageError, match="damaged"):
        dataset.read(folder)


def test_an_action_is_decoded_from_eight_numbers():
    for numbers, action in (
        ((1, 0, 0, 0, 250, 400, 6.5, 0), Go(250.0, 400.0, 6.5)),
        ((0, 1, 0, 0, 0, 0, 0, -30), Rotate(-30.0)),
        ((0, 0, 1, 0, 0, 0, 0, 0), Think()),
        ((0, 0, 0, 1, 0, 0, 0, 0), Finished()),
    ):
        assert action_of(np.array(numbers, np.float32)) == action, numbers


def test_eight_numbers_that_are_not_an_action_are_rejected():
    for numbers in ((0,) * 8, (1, 1, 0, 0, 0, 0, 0, 0)):
        with pytest.raises(UsageError):
            action_of(np.array(numbers, np.float32))


def test_only_its_name_decides_whether_a_flight_is_held_out():
    names = [f"residential-approaching-{k}" for k in range(11, 91)]
    kept = [name for name in names if dataset.is_held_out(name)]
    assert 3 <= len(kept) <= 20
    assert kept == [name for name in reversed(names) if dataset.is_held_out(name)][::-1]
