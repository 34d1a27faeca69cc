"""Plans on their way in, one per client: an upload is collected apart and put in force as a whole.

Source: mavlink.io/en/services/mission.html; retry 0.25 s, time-out 5 s as PX4.
"""

from dataclasses import dataclass, field

from autopilot.commander.plan.items import PlanItem
from autopilot.mavlink.port import Port
from foundation.mavlink import dialect

RETRY_US = 250_000
TIMEOUT_US = 5_000_000
MOST_UPLOADS = 16  # at once, of all clients; a hostile client cannot fill the memory
CANCELLED = int(dialect.MAV_MISSION_OPERATION_CANCELLED)

Key = tuple[int, int, int, int]  # port, system, component, mission type


@dataclass(slots=True)
class Upload:
    """A plan on its way in."""

    port: Port
    client: tuple[int, int]
    kind: int
    count: int
    heard_us: int
    asked_us: int
    items: list[PlanItem] = field(default_factory=list)
    taken_us: int | None = None  # when it was complete: a repeated last item is then acknowledged again

    def ask(self, now_us: int) -> None:
        """Request the next item."""
        self.asked_us = now_us
        self.port.send(dialect.MAVLink_mission_request_int_message(*self.client, len(self.items), self.kind))

    def acknowledge(self, result: int) -> None:
        self.port.send(dialect.MAVLink_mission_ack_message(*self.client, result, self.kind))


class Uploads:
    """The uploads of all clients."""

    def __init__(self) -> None:
        self._open: dict[Key, Upload] = {}

    def begin(self, key: Key, upload: Upload) -> bool:
        """Start an upload in the place of an older one of the same client. Returns False when there are too many."""
        if key not in self._open and len(self._open) >= MOST_UPLOADS:
            return False
        self._open[key] = upload
        return True

    def get(self, key: Key) -> Upload | None:
        return self._open.get(key)

    def end(self, key: Key) -> None:
        self._open.pop(key, None)

    def tick(self, now_us: int) -> None:
        """Ask again for what did not come; give up on a client that has gone."""
        if not self._open:
            return
        for key, upload in list(self._open.items()):
            if now_us - upload.heard_us >= TIMEOUT_US:
                if upload.taken_us is None:
                    upload.acknowledge(CANCELLED)
                self.end(key)
            elif upload.taken_us is None and now_us - upload.asked_us >= RETRY_US:
                upload.ask(now_us)
