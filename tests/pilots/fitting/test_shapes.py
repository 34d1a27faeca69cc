"""Tests the fit of the shape network, and its training pictures."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dronecats.pilots.fitting import shapes, training
from dronecats.pilots.fitting import shapes as campuses
from dronecats.pilots.fitting.shapes import VisibleThing
from dronecats.pilots.vision import shape_detector
from episodes import maps

SIZE = shape_detector.WINDOW[0] * shape_detector.WINDOW[1] * shape_detector.CHANNELS


def patterns(count=600):
    """Return noisy windows of three kinds."""
    rng = np.random.default_rng(3)
    kinds = rng.integers(0, 3, count).astype(np.int8)
    means = rng.normal(0.0, 0.3, (3, SIZE))
    return training.Examples((means[kinds] + rng.normal(0.0, 0.3, (count, SIZE))).astype(np.float16), kinds)


def test_the_fit_learns_the_examples_and_is_reproducible():
    examples = patterns()
    once, again = shapes.fit(examples, 12, 1), shapes.fit(examples, 12, 1)
    kinds = once.probabilities(examples.inputs.astype(np.float32)).argmax(axis=1)
    assert (kinds == examples.labels).mean() > 0.95
    assert all(np.array_equal(getattr(once, name), getattr(again, name)) for name in ("hidden", "out"))


def test_the_gradients_match_finite_differences_of_the_cross_entropy():
    rng = np.random.default_rng(5)
    examples = patterns(8)
    x = examples.inputs.astype(np.float64)
    kinds = len(shape_detector.KINDS)
    weights = [rng.normal(0.0, 0.05, s) for s in ((SIZE, 6), (6,), (6, kinds), (kinds,))]

    def cost():
        raw = np.maximum(x @ weights[0] + weights[1], 0.0) @ weights[2] + weights[3]
        return float(np.mean(np.log(np.exp(raw).sum(axis=1)) - raw[np.arange(len(x)), examples.labels]))

    output_gradient = shapes.cross_entropy_gradient(examples.labels)
    gradients = training.gradients(weights, x, np.ones((len(x), 6)), output_gradient)
    for which, at in ((0, (7, 2)), (1, (3,)), (3, (1,))):
        before, step = cost(), 1e-6
        weights[which][at] += step
        assert gradients[which][at] == pytest.approx((cost() - before) / step, rel=1e-3, abs=1e-7)
        weights[which][at] -= step


def test_mirroring_windows_twice_restores_them():
    windows = patterns(5).inputs.astype(np.float32)
    assert np.array_equal(shapes.mirrored(shapes.mirrored(windows)), windows)
    assert not np.array_equal(shapes.mirrored(windows), windows)


def test_training_campuses_share_no_fixture_position_with_the_campus_of_the_episodes():
    """The detector must learn the appearance of fixtures, not their positions on the map of the episodes."""
    there = {(i.kind, i.position_ned[:2]) for i in maps.build("campus", 1).instances if i.kind in shape_detector.KINDS}
    for seed in (200, 201):
        ours = {(i.kind, i.position_ned[:2]) for i in campuses.build(seed).instances}
        assert there
        assert not there & ours


def test_a_window_is_labelled_with_the_thing_at_its_centre_and_depth():
    for depth, right, below, holds in ((1.0, 0.0, 0.0, True), (1.5, 0.0, 0.0, False), (1.0, 2.0, 0.0, False)):
        strip = shape_detector.strips(np.zeros((360, 640, 3), np.uint8))[8]
        foot_m = shape_detector.HEIGHTS_M[1] + below
        thing = VisibleThing("planter", strip.depth_m * depth, right, foot_m, (0, 0, 1, 1), 100, 100.0)
        kinds = shapes.labels(strip, 1, [thing], {"planter": 1.0})
        middle = np.abs(strip.rights_m()).argmin()
        assert (kinds[middle] == shape_detector.KINDS.index("planter")) == holds, (depth, right)


@pytest.mark.slow
def test_the_command_runs_and_writes_only_to_out(tmp_path):
    shipped = Path(shape_detector.__file__).with_name(shape_detector.ShapeNetwork.FILE)
    before, file = shipped.read_bytes(), tmp_path / shape_detector.ShapeNetwork.FILE
    command = [sys.executable, "-m", "dronecats.pilots.fitting", "shapes", "--short", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "picnic-table" in done.stdout
    assert shape_detector.ShapeNetwork.load(file).hidden.shape == (SIZE, shapes.HIDDEN)
    assert shipped.read_bytes() == before
