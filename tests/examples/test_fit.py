"""Fits the head for a few steps on a few synthetic pictures. Requires PyTorch."""

from dataclasses import asdict

import numpy as np
import pytest

from examples.action_head import features
from examples.action_head.dataset import Decisions
from examples.action_head.settings import Shape, Training
from foundation.errors import UsageError
from tests.needs import reason

torch = pytest.importorskip("torch", reason=reason("torch"))

from examples.action_head import fit, network, train  # noqa: E402

SMALL = Shape(channels=16, words=8, hidden=16)


def made_up(count=48):
    """Return decisions on a blue square: go to it, turn if there is none, declare if it is large."""
    numbers = np.random.default_rng(1)
    pictures = np.full((count, 3, features.HEIGHT, features.WIDTH), 120, np.uint8)
    kinds = np.arange(count) % 4
    kinds[kinds == 2] = 0  # no `think` decisions
    points = numbers.uniform(0.2, 0.8, (count, 2)).astype(np.float32)
    for k, (x, y) in enumerate(points * (features.WIDTH, features.HEIGHT)):
        half = {0: 8, 3: 40}.get(int(kinds[k]), 0)
        rows = slice(max(0, int(y) - half), int(y) + half)
        pictures[k, :, rows, max(0, int(x) - half) : int(x) + half] = np.array((20, 20, 240))[:, None, None]
    word_vectors = np.stack([features.words("go to the blue square")] * count)
    return Decisions(
        pictures=pictures,
        words=np.stack([word_vectors, word_vectors]),
        past=np.zeros((2, count, features.PAST), np.float32),
        kinds=kinds,
        points=points,
        depths_m=np.full(count, 8.0, np.float32),
        angles_deg=np.full(count, 45.0, np.float32),
        flights=np.arange(count) // 8,
        held_out=np.arange(count) >= count - 8,
    )


def fitted(data, epochs, seed=0):
    losses = []
    head = fit.fit(data, SMALL, Training(epochs=epochs, batch=8, seed=seed), lambda _, loss: losses.append(loss))
    return head, losses


def test_the_loss_falls_and_the_held_out_decisions_are_evaluated():
    data = made_up()
    head, losses = fitted(data, 12)
    assert losses[-1] < 0.75 * losses[0]
    judgement = fit.judged(head, data)
    assert judgement is not None
    assert judgement.decisions == 8
    assert (judgement.declared, judgement.precise) == (
        1.0,
        1.0,
    )  # large squares are separable from small ones and from none


def test_the_same_seed_gives_the_same_weights_and_another_seed_different_ones():
    data = made_up(16)
    one, same, other = (fitted(data, 1, seed)[0].state_dict() for seed in (3, 3, 4))
    assert all(torch.equal(one[name], same[name]) for name in one)
    assert any(not torch.equal(one[name], other[name]) for name in one)


def test_a_mirrored_decision_points_to_the_other_side():
    data = made_up()
    numbers = np.random.default_rng(0)
    chosen = np.flatnonzero(data.kinds == 0)
    batch = fit.drawn(data, chosen, numbers)
    for picture, place in zip(batch.pictures.numpy(), batch.points.numpy(), strict=True):
        rows, columns = np.nonzero(picture[2] > 200)
        if len(columns) == 256:  # the square is completely in the picture
            x, y = (columns.mean() + 0.5) / features.WIDTH, (rows.mean() + 0.5) / features.HEIGHT
            assert (x, y) == (pytest.approx(place[0], abs=0.01), pytest.approx(place[1], abs=0.01))
    mirrored = batch.angles_deg.numpy() < 0
    assert 0 < mirrored.sum() < len(chosen)


def test_a_shifted_picture_repeats_its_edge_pixels():
    shown = torch.arange(8, dtype=torch.uint8)[None, None].expand(1, 2, 8)
    assert fit.moved(shown, 3, 0)[0, 0].tolist() == [0, 0, 0, 0, 1, 2, 3, 4]
    assert fit.moved(shown, -2, 1)[0, 0].tolist() == [2, 3, 4, 5, 6, 7, 7, 7]


def test_decisions_with_a_wrong_target_name_become_turns():
    data = made_up(40)
    data.words[:, ::2] = features.words("go to the red sphere")
    batch = fit.drawn(data, np.arange(40), np.random.default_rng(0))
    misnamed = ~batch.named.numpy()
    assert 0 < misnamed.sum() < 20
    assert (batch.kinds.numpy()[misnamed] == 1).all()
    assert (batch.words.numpy()[misnamed] != data.words[0][misnamed]).any(1).all()
    assert (batch.words.numpy()[~misnamed] == data.words[0][~misnamed]).all()
    assert (batch.kinds.numpy()[~misnamed] == data.kinds[~misnamed]).all()


def test_the_threshold_separates_right_from_wrong_declarations():
    chance = np.array([0.1, 0.2, 0.3, 0.62, 0.7, 0.9])
    assert 0.3 < fit.threshold(chance, chance > 0.5) <= 0.62


def test_a_saved_head_loads_with_the_same_outputs(tmp_path):
    head, _ = fitted(made_up(16), 1)
    network.save(tmp_path / "head.pt", head, 0.35, {"flights": 2})
    again, declares_at = network.load(tmp_path / "head.pt")
    assert declares_at == 0.35
    data = made_up(16)
    inputs = (data.pictures[0], data.words[0, 0], data.past[0, 0])
    np.testing.assert_array_equal(again.outlook(*inputs).heat, head.outlook(*inputs).heat)


def test_files_that_are_not_heads_are_rejected(tmp_path):
    with pytest.raises(UsageError, match=r"none\.pt"):
        network.load(tmp_path / "none.pt")
    (tmp_path / "text.pt").write_text("no head")
    with pytest.raises(UsageError, match=r"text\.pt"):
        network.load(tmp_path / "text.pt")
    head = network.ActionHead(SMALL)
    document = {"format": network.FORMAT + 1, "shape": asdict(SMALL), "declares_at": 0.5, "weights": head.state_dict()}
    torch.save(document, tmp_path / "later.pt")
    with pytest.raises(UsageError, match=r"later\.pt.*version"):
        network.load(tmp_path / "later.pt")


def test_training_without_a_held_out_flight_is_rejected(dataset_folder, tmp_path):
    with pytest.raises(UsageError, match="held-out"):
        train.main([str(dataset_folder), "--out", str(tmp_path / "head.pt"), "--epochs", "1"])
    assert not (tmp_path / "head.pt").exists()
