"""Views of the shipped maps from a handful of poses, as one SHA-256 per frame.

    python -m tests.episodes.camera.renderer.frame_hashes

records them anew, after a change that is meant to change pictures.
"""

import hashlib
import json
import math
from pathlib import Path

from episodes import maps
from episodes.camera.renderer import Renderer
from foundation.camera import CameraModel, CameraPose
from foundation.frames import quat_from_euler

FILE = Path(__file__).with_suffix(".json")
MAPS = ("residential", "campus", "blocks")
CAMERA = CameraModel(640, 360)
# m above the ground at the spawn, degrees of pitch and of yaw against the spawn's
VIEWS = ((2.0, 0.0, 0.0), (2.0, 0.0, 135.0), (8.0, -20.0, 250.0), (30.0, -70.0, 60.0))


def frame_hashes(name: str, threads: int) -> list[str]:
    """Return the digest of picture, depth and ids of every view of the map `name`."""
    scene = maps.build(name)
    n, e, d = scene.spawn_ned
    renderer = Renderer(scene, CAMERA, threads)
    digests = []
    for height, pitch, turn in VIEWS:
        attitude = quat_from_euler(0.0, math.radians(pitch), scene.spawn_yaw + math.radians(turn))
        view = renderer.render(CameraPose((n, e, d - height), attitude))
        digests.append(hashlib.sha256(view.rgb.tobytes() + view.depth.tobytes() + view.ids.tobytes()).hexdigest())
    renderer.close()
    return digests


if __name__ == "__main__":
    fresh = {name: [[digest] for digest in frame_hashes(name, 2)] for name in MAPS}
    FILE.write_text(json.dumps(fresh, indent=2) + "\n", encoding="utf-8")
