"""The shipped maps look as at the last visual review: no byte of picture, depth or ids has changed.

After an intended change of a map or of the renderer, record them again:
`python -m tests.episodes.camera.renderer.frame_hashes`. A view may have several: where two faces lie in one plane,
processors with wider vectors meet the other one in a few pixels.
"""

import json

import pytest

from tests.episodes.camera.renderer.frame_hashes import FILE, MAPS, VIEWS, frame_hashes


@pytest.mark.parametrize(("name", "threads"), [*((name, 2) for name in MAPS), ("blocks", 1)])
def test_every_frame_is_the_recorded_one(name, threads):
    recorded = json.loads(FILE.read_text(encoding="utf-8"))[name]
    assert [digest in accepted for digest, accepted in zip(frame_hashes(name, threads), recorded, strict=True)] == [
        True
    ] * 4


def test_the_record_tells_every_view_apart():
    recorded = json.loads(FILE.read_text(encoding="utf-8"))
    assert tuple(recorded) == MAPS
    every = [digest for views in recorded.values() for accepted in views for digest in accepted]
    assert len(set(every)) == len(every) >= len(MAPS) * len(VIEWS)
