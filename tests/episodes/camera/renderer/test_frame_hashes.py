"""Frames of the shipped maps match the hashes of the last visual review, byte by byte.

After an intended change of a map or of the renderer, record the hashes again:
`python -m tests.episodes.camera.renderer.frame_hashes`. A view may have several accepted hashes: if two faces lie in
one plane, processors with wider vectors draw the other face in a few pixels.
"""

import json

import pytest

from tests.episodes.camera.renderer.frame_hashes import FILE, MAPS, VIEWS, frame_hashes


@pytest.mark.parametrize(("name", "threads"), [*((name, 2) for name in MAPS), ("blocks", 1)])
def test_every_frame_matches_a_recorded_hash(name, threads):
    recorded = json.loads(FILE.read_text(encoding="utf-8"))[name]
    assert [digest in accepted for digest, accepted in zip(frame_hashes(name, threads), recorded, strict=True)] == [
        True
    ] * 4


def test_the_recorded_hashes_are_distinct():
    recorded = json.loads(FILE.read_text(encoding="utf-8"))
    assert tuple(recorded) == MAPS
    every = [digest for views in recorded.values() for accepted in views for digest in accepted]
    assert len(set(every)) == len(every) >= len(MAPS) * len(VIEWS)
