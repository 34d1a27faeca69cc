"""The shipped maps look as they did when a person last looked: not one byte of picture, depth or ids has changed.

A change of a map or of the renderer that is meant records them anew: `python tests/render/frame_hashes.py`.
"""

import json

import pytest
from frame_hashes import FILE, MAPS, VIEWS, frame_hashes


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("name", MAPS)
def test_every_frame_is_the_recorded_one(name, threads):
    assert frame_hashes(name, threads) == json.loads(FILE.read_text(encoding="utf-8"))[name]


def test_the_record_tells_every_view_apart():
    recorded = json.loads(FILE.read_text(encoding="utf-8"))
    assert tuple(recorded) == MAPS
    every = [digest for digests in recorded.values() for digest in digests]
    assert len(set(every)) == len(MAPS) * len(VIEWS)
