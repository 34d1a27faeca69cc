"""What pilots were shown, as it comes into the run folder."""

import re
import time
from pathlib import Path

from foundation.run_folder import layout

NAME = re.compile(r"(\d{6,})(?:_d(\d+))?\.jpg")
END = b"\xff\xd9"  # of a JPEG that has been written to its end
KEPT = 4  # pictures of each drone
SETTLED_NS = 100_000_000  # a folder that has changed this lately may change once more without another time


class PictureTail:
    """The pictures of an episode; of each drone the newest are kept."""

    def __init__(self, folder: Path) -> None:
        """`folder` holds the pictures, as soon as it is there."""
        self._folder = folder
        self._seen_ns = -1  # when the folder had changed last
        self._newest: dict[int, int] = {}
        self._read: dict[tuple[int, int], bytes] = {}

    def newest(self, drone: int) -> tuple[int, bytes] | None:
        """Return (frame_id, JPEG) of a drone's newest picture that is whole, None where there is none."""
        self._look()
        frame_id = self._newest.get(drone)
        jpeg = None if frame_id is None else self.of(drone, frame_id)
        return None if frame_id is None or jpeg is None else (frame_id, jpeg)

    def of(self, drone: int, frame_id: int) -> bytes | None:
        """Return a picture, None where it is not there or not whole yet."""
        if (known := self._read.get((drone, frame_id))) is not None:
            return known
        try:
            jpeg = (self._folder / layout.frame_name(frame_id, drone)).read_bytes()
        except OSError:
            return None
        if not jpeg.endswith(END):
            return None
        mine = [key for key in self._read if key[0] == drone]
        if len(mine) >= KEPT:
            del self._read[mine[0]]
        self._read[drone, frame_id] = jpeg
        return jpeg

    def _look(self) -> None:
        """Look which pictures there are, if some have come."""
        try:
            changed_ns = self._folder.stat().st_mtime_ns
            if changed_ns == self._seen_ns:
                return
            names = [path.name for path in self._folder.iterdir()]
        except OSError:
            return
        self._seen_ns = changed_ns if time.time_ns() - changed_ns > SETTLED_NS else -1
        for name in names:
            if (found := NAME.fullmatch(name)) is not None:
                drone = int(found[2] or 0)
                self._newest[drone] = max(self._newest.get(drone, 0), int(found[1]))
