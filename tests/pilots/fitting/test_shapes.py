"""The fit of the vision pilot's network, and the pictures that it learns from."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dronecats.pilots.fitting.shapes import campuses, examples, fit
from dronecats.pilots.fitting.shapes.campuses import Shown
from dronecats.pilots.vision import shape_detector
from episodes import maps

SIZE = shape_detector.WINDOW[0] * shape_detector.WINDOW[1] * shape_detector.CHANNELS


def patterns(count=600):
    """Return windows of three kinds that noise covers."""
    rng = np.random.default_rng(3)
    kinds = rng.integers(0, 3, count).astype(np.int8)
    each = rng.normal(0.0, 0.3, (3, SIZE))
    return examples.Examples((each[kinds] + rng.normal(0.0, 0.3, (count, SIZE))).astype(np.float16), kinds)


def test_the_fit_learns_what_can_be_learnt_and_learns_it_again():
    known = patterns()
    once, again = fit.fit(known, 12, 1), fit.fit(known, 12, 1)
    said = once.probabilities(known.windows.astype(np.float32)).argmax(axis=1)
    assert (said == known.kinds).mean() > 0.95
    assert all(np.array_equal(getattr(once, name), getattr(again, name)) for name in ("hidden", "out"))


def test_its_slopes_are_those_of_the_cross_entropy():
    rng = np.random.default_rng(5)
    known = patterns(8)
    x = known.windows.astype(np.float64)
    weights = [rng.normal(0.0, 0.05, s) for s in ((SIZE, 6), (6,), (6, len(shape_detector.KINDS)), (len(shape_detector.KINDS),))]

    def cost():
        raw = np.maximum(x @ weights[0] + weights[1], 0.0) @ weights[2] + weights[3]
        return float(np.mean(np.log(np.exp(raw).sum(axis=1)) - raw[np.arange(len(x)), known.kinds]))

    slopes = fit.slopes_of(weights, x, known.kinds, np.ones((len(x), 6)))
    for which, at in ((0, (7, 2)), (1, (3,)), (3, (1,))):
        before, step = cost(), 1e-6
        weights[which][at] += step
        assert slopes[which][at] == pytest.approx((cost() - before) / step, rel=1e-3, abs=1e-7)
        weights[which][at] -= step


def test_a_mirror_turned_twice_shows_what_is_there():
    windows = patterns(5).windows.astype(np.float32)
    assert np.array_equal(fit.mirrored(fit.mirrored(windows)), windows)
    assert not np.array_equal(fit.mirrored(windows), windows)


def test_nothing_stands_where_the_records_campus_has_it():
    """What is learnt is how things look: no fixture of the map that is flown is where it is there."""
    there = {(i.kind, i.position_ned[:2]) for i in maps.build("campus", 1).instances if i.kind in shape_detector.KINDS}
    for seed in (200, 201):
        ours = {(i.kind, i.position_ned[:2]) for i in campuses.build(seed).instances}
        assert there
        assert not there & ours


def test_a_window_holds_what_stands_in_its_middle_at_its_distance():
    for depth, right, below, held in ((1.0, 0.0, 0.0, True), (1.5, 0.0, 0.0, False), (1.0, 2.0, 0.0, False)):
        strip = shape_detector.strips(np.zeros((360, 640, 3), np.uint8))[8]
        one = Shown("planter", strip.depth_m * depth, right, shape_detector.HEIGHTS_M[1] + below, (0, 0, 1, 1), 100, 100.0)
        said = examples.labels(strip, 1, [one], {"planter": 1.0})
        middle = np.abs(strip.rights_m()).argmin()
        assert (said[middle] == shape_detector.KINDS.index("planter")) == held, (depth, right)


@pytest.mark.slow
def test_the_command_runs_and_writes_only_where_it_is_told(tmp_path):
    shipped = Path(shape_detector.__file__).with_name("shapes.npz")
    before, file = shipped.read_bytes(), tmp_path / "network.npz"
    command = [sys.executable, "-m", "dronecats.pilots.fitting.shapes", "--short", "--out", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "picnic-table" in done.stdout
    assert shape_detector.load_network(file).hidden.shape == (SIZE, fit.HIDDEN)
    assert shipped.read_bytes() == before
