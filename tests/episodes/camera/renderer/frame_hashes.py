"""SHA-256 hashes of frames of the shipped maps, from four poses each.

After an intended change of the pictures, record the hashes again:

    python -m tests.episodes.camera.renderer.frame_hashes
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
# height above the spawn (m), pitch (degrees), yaw relative to the spawn's (degrees)
VIEWS = ((2.0, 0.0, 0.0), (2.0, 0.0, 135.0), (8.0, -20.0, 250.0), (30.0, -70.0, 60.0))


def frame_hashes(name: str, threads: int) -> list[str]:
    """Return a digest of picture, depth and ids for each view of the map `name`."""
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
