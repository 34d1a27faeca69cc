"""Two flights are of the same kind, or their identity.json files differ."""

import hashlib
import json
import shutil

import pytest

from dronecats.flight.run import identity
from dronecats.flight.run.identity import code_digest, protocol_numbers, suite_digest, write_identity
from foundation import protocol
from foundation.run_folder.reading import json_object
from foundation.run_folder.rows import EpisodeIdentity


@pytest.fixture
def sources(tmp_path, monkeypatch):
    """Copy the sources that are part of the digest."""
    for folder in (*identity.FOLDERS, identity.JUDGE):
        shutil.copytree(identity.ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(identity, "ROOT", tmp_path)
    code_digest.cache_clear()
    yield tmp_path
    code_digest.cache_clear()


def digest_now():
    code_digest.cache_clear()
    return code_digest()


def edited(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_changes_to_flight_code_change_the_digest(sources):
    seen = [digest_now()]
    edited(sources / "dronecats/agent/controller.py", "= ", "= 1 + ")
    seen.append(digest_now())
    with (sources / "dronecats/agent/prompt.txt").open("a") as file:
        file.write("Fly slowly.")
    seen.append(digest_now())
    edited(sources / "vehicles/airframes/x500.toml", "mass_kg = ", "mass_kg = 1")
    seen.append(digest_now())
    weights = next((sources / "dronecats/pilots").rglob("*.npz"))
    weights.write_bytes(weights.read_bytes() + b" ")
    seen.append(digest_now())
    (sources / "hil/more.py").write_text("SPEED = 1.0\n")
    seen.append(digest_now())
    edited(sources / "hil/more.py", "1.0", "1.1")
    seen.append(digest_now())
    assert len(set(seen)) == len(seen)


def test_moved_files_and_comments_do_not_change_the_digest(sources):
    before = digest_now()
    controller = sources / "dronecats/agent/controller.py"
    edited(controller, "\n\n\n", "\n\n\n# a comment\n\n\n")
    edited(controller, '"""', '"""In other words: ')
    edited(sources / "vehicles/airframes/x500.toml", "\n", "\n# a comment\n")
    (sources / "dronecats/flight/spec/moved").mkdir()
    controller.rename(sources / "dronecats/flight/spec/moved/steering.py")
    (sources / "vehicles/airframes/x500.toml").rename(sources / "vehicles/x500.toml")
    assert digest_now() == before


def test_a_function_that_moves_to_another_file_does_not_change_the_digest(sources):
    (sources / "hil/a.py").write_text("import math\n\n\ndef half(x):\n    return x / 2\n\n\nLIMIT = 3\n")
    before = digest_now()
    (sources / "hil/a.py").write_text('"""Limits."""\n\nLIMIT = 3\n')
    (sources / "dronecats/flight/run/b.py").write_text("def half(x):\n    # of it\n    return x / 2\n")
    assert digest_now() == before


def test_the_command_line_and_pilot_fitting_are_not_in_the_digest(sources):
    before = digest_now()
    edited(sources / identity.FITTING / "training.py", "BATCH = ", "BATCH = 1")
    assert digest_now() == before
    (sources / "dronecats" / "cli").mkdir()
    (sources / "dronecats" / "cli" / "main.py").write_text("x = 1\n")
    assert digest_now() == before


def test_the_digest_is_computed_once_and_cached(sources, monkeypatch):
    before = digest_now()
    monkeypatch.setattr(identity, "statements", lambda *_: pytest.fail("parsed again"))
    assert digest_now() == before


def test_protocol_numbers_hold_every_constant_of_the_protocol():
    numbers = protocol_numbers()
    assert numbers["CAP_S"] == protocol.CAP_S
    assert numbers["GO"] == "go"
    lists = {"ACTIONS", "ACTION_FIELDS"}  # lists of action names and of reply fields
    assert set(numbers) == {name for name in vars(protocol) if name.isupper()} - lists
    assert set(protocol.ACTIONS) <= set(numbers.values())
    json.dumps(numbers)


def test_a_suite_digest_does_not_depend_on_the_order_of_its_records():
    pairs = [("b", "two"), ("a", "one")]
    assert suite_digest(pairs) == suite_digest(reversed(pairs)) != suite_digest([("b", "two"), ("a", "other")])


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "frames").mkdir()
    (tmp_path / "episode.json").write_text('{"id": "a"}')
    step = {"drone": 0, "frame_id": 0, "t_frame": 0.0, "t_decided": 1.0, "action": None}
    replies = [
        {"served": "gpt-5-2026-01-01 fp_1"},
        {},
        {"served": "gpt-5-2026-01-01 fp_2"},
        {"served": "gpt-5-2026-01-01 fp_1"},
    ]
    lines = [json.dumps({"step": k, **step, **reply}) for k, reply in enumerate(replies)]
    (tmp_path / "decisions.jsonl").write_text("\n".join(lines) + "\n")
    for name in ("000010.jpg", "000009.jpg"):
        (tmp_path / "frames" / name).write_bytes(name.encode())
    return tmp_path


def test_an_episode_identity_holds_record_frames_and_served_models(folder):
    episode_identity = write_identity(folder)
    assert episode_identity.record_sha256 == hashlib.sha256(b'{"id": "a"}').hexdigest()
    assert (episode_identity.frames, episode_identity.frames_sha256) == (
        2,
        hashlib.sha256(b"000009.jpg000010.jpg").hexdigest(),
    )
    assert episode_identity.served == ("gpt-5-2026-01-01 fp_1", "gpt-5-2026-01-01 fp_2")
    exchange = {"number": 0, "t_asked": 0.0, "t_answered": 1.0, "causes": [], "roster": "", "frames": [], "reply": "{}",
                "orders": [], "confirms": [], "model": "m", "served": "commander-1"}  # fmt: skip
    (folder / "commander.jsonl").write_text(json.dumps(exchange) + "\n")
    assert write_identity(folder).served == (*episode_identity.served, "commander-1")
    write_identity(folder, {"late": 2.0})
    stored = json_object(folder / "identity.json")
    assert stored is not None
    assert stored["pace"] == {"late": 2.0}
    assert set(stored) == set(EpisodeIdentity.__dataclass_fields__)


def test_an_aborted_flight_without_logs_has_an_identity(tmp_path):
    episode_identity = write_identity(tmp_path)
    assert (
        episode_identity.record_sha256,
        episode_identity.frames,
        episode_identity.frames_sha256,
        episode_identity.served,
    ) == (None, 0, None, ())
