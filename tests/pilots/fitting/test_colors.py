"""Tests the fit of the colour network, its training pictures, and the outlines."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dronecats.pilots.fitting import colors, training
from dronecats.pilots.fitting import colors as neighbourhoods
from dronecats.pilots.vision import color_detector
from dronecats.pilots.vision.ranging import BoundingBox, Range
from episodes.records import catalogue

PATCH = color_detector.SIDE * color_detector.SIDE * color_detector.CHANNELS


def two_looks(count=500):
    """Return noisy examples of two appearances. One is the target, with a distance factor of 1.5."""
    rng = np.random.default_rng(3)
    is_target = rng.integers(0, 2, count).astype(np.float32)
    looks = rng.normal(0.0, 0.3, (2, color_detector.LENGTH))
    seen = looks[is_target.astype(int)] + rng.normal(0.0, 0.2, (count, color_detector.LENGTH))
    return training.Examples(
        seen.astype(np.float16), np.stack((is_target, is_target * np.float32(np.log(1.5))), axis=1)
    )


def test_the_fit_learns_the_examples_and_is_reproducible():
    examples = two_looks()
    once, again = colors.fit(examples, 25, 1), colors.fit(examples, 25, 1)
    probability, factor = once.classify(examples.inputs.astype(np.float32))
    assert ((probability > 0.5) == (examples.labels[:, 0] > 0.5)).mean() > 0.97
    assert np.median(factor[examples.labels[:, 0] > 0.5]) == pytest.approx(1.5, rel=0.06)
    assert np.array_equal(once.hidden, again.hidden)


def test_the_gradients_match_finite_differences_of_the_cost():
    rng = np.random.default_rng(5)
    examples = two_looks(8)
    x = examples.inputs.astype(np.float64)
    weights = [rng.normal(0.0, 0.02, s) for s in ((color_detector.LENGTH, 6), (6,), (6, 2), (2,))]

    def cost():
        raw = np.maximum(x @ weights[0] + weights[1], 0.0) @ weights[2] + weights[3]
        entropy = np.log1p(np.exp(raw[:, 0])) - examples.labels[:, 0] * raw[:, 0]
        off = np.abs(raw[:, 1] - examples.labels[:, 1] / colors.DISTANCE_SCALE)
        huber = np.where(off <= 3.0, 0.5 * off**2, 3.0 * off - 4.5)
        return float(np.mean(entropy + 0.1 * colors.DISTANCE_WEIGHT * examples.labels[:, 0] * huber))

    output_gradient = colors.cost_gradient(examples.labels)
    gradients = training.gradients(weights, x, np.ones((len(x), 6)), output_gradient)
    for which, at in ((0, (7, 2)), (1, (3,)), (2, (4, 1)), (3, (0,)), (3, (1,))):
        before, step = cost(), 1e-6
        weights[which][at] += step
        assert gradients[which][at] == pytest.approx((cost() - before) / step, rel=1e-3, abs=1e-7)
        weights[which][at] -= step


def test_a_mirrored_input_is_that_of_the_mirrored_picture_and_mirroring_twice_restores_it():
    picture = np.random.default_rng(1).integers(0, 256, (36, 64, 3), dtype=np.uint8)
    there = Range(6.0, 6.6, 0.5, 0.8)

    def input_of(image, left, right):
        layers = color_detector.picture_layers(image, image[:, :, 0] > 128)
        return color_detector.network_input(layers, BoundingBox(left, -0.1, right, 0.2), there, "suv", "red")[None]

    seen = input_of(picture, -0.25, 0.0)
    other = colors.mirrored(seen)
    assert np.allclose(other[:, PATCH:], input_of(picture[:, ::-1], 0.0, 0.25)[:, PATCH:])
    assert np.array_equal(colors.mirrored(other), seen)


def test_no_episode_record_uses_a_map_seed_of_the_fit():
    map_seeds = {catalogue.load(name).map_seed for name in catalogue.ids() if name.startswith("residential")}
    assert map_seeds
    assert not map_seeds & set(range(colors.FIT_SEED, colors.FIT_SEED + colors.SCENES))
    assert not map_seeds & set(range(colors.CHECK_SEED, colors.CHECK_SEED + colors.CHECK_SCENES))


def test_overlap_is_the_common_share_of_the_union_and_of_one_box():
    for true, union, inside in (
        ((320, 180, 384, 212), 1.0, 1.0),
        ((352, 180, 416, 212), 1 / 3, 0.5),
        ((0, 0, 64, 64), 0.0, 0.0),
        (None, 0.0, 0.0),
    ):
        shares = colors.overlap(BoundingBox(0.0, 0.0, 0.1, 0.05), true, (360, 640))
        assert shares == pytest.approx((union, inside)), true


def test_the_shipped_outlines_match_the_assets():
    for asset in neighbourhoods.NOUNS:
        with np.load(Path(color_detector.__file__).with_name(colors.OUTLINES)) as kept:
            assert np.array_equal(kept[asset], colors.outline(asset)), asset


@pytest.mark.slow
def test_most_targets_outside_the_fit_are_detected_with_few_false_detections():
    jpegs = colors.draw(colors.CHECK_SEED + 50, 1, 40)
    results = colors.evaluate(color_detector.PatchNetwork.shipped(), jpegs)
    present = [r for r in results if r.target.box is not None and r.target.distance_m < 22.0]
    absent = [r for r in results if r.target.box is None]
    ranges = [r.detected_m / r.target.distance_m for r in present if r.is_right and r.detected_m]
    assert len(present) >= 15
    assert len(absent) >= 5
    assert sum(r.is_right for r in present) >= 0.75 * len(present)
    assert sum(r.detected_m is not None for r in absent) <= 1
    assert np.median(np.abs(np.log(ranges))) < 0.12


@pytest.mark.slow
def test_the_command_runs_and_writes_only_to_out(tmp_path):
    shipped = Path(color_detector.__file__).with_name(color_detector.PatchNetwork.FILE)
    before = shipped.read_bytes()
    run = [sys.executable, "-m", "dronecats.pilots.fitting", "colors", "--short", "--out", str(tmp_path)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=600, cwd=Path(__file__).parents[3])
    assert done.returncode == 0, done.stderr
    assert done.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["outlines.npz", "patch_network.npz"]
    assert shipped.read_bytes() == before
