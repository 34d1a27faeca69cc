"""What the autopilot says in words: STATUSTEXT, with texts that came in several pieces put together."""

from collections import deque
from dataclasses import dataclass

from dronecats.border.mavlink import dialect

WARNING = dialect.MAV_SEVERITY_WARNING  # 4; smaller is worse
KEPT = 50


@dataclass(frozen=True, slots=True)
class Said:
    """One text."""

    time_us: int  # µs, the vehicle's clock at the newest telemetry before it
    severity: int  # MAV_SEVERITY
    text: str


class StatusTexts:
    """The newest texts of one autopilot."""

    def __init__(self) -> None:
        self.newest: deque[Said] = deque(maxlen=KEPT)
        self._pieces: dict[int, list[str]] = {}  # text id -> its pieces so far

    def take(self, message: dialect.MAVLink_message, time_us: int) -> Said | None:
        """Return the text that this STATUSTEXT completes. A piece that was lost costs what came before it."""
        text = _plain(message.text)
        if message.id:
            pieces = self._pieces.setdefault(message.id, [])
            if message.chunk_seq != len(pieces):
                pieces.clear()
            pieces.append(text)
            if len(text) >= 50:
                return None  # a full piece has a successor
            text = "".join(self._pieces.pop(message.id))
        said = Said(time_us, message.severity, " ".join(text.split()))
        self.newest.append(said)
        return said

    def since(self, time_us: int) -> str:
        """Return the warnings and worse that were said from then on, in order, joined; empty when there was none."""
        texts = [said.text for said in self.newest if said.time_us >= time_us and said.severity <= WARNING]
        return "; ".join(dict.fromkeys(texts))


def _plain(text: str | bytes) -> str:
    decoded = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return decoded.split("\0", 1)[0]
