"""What the autopilot says in words: STATUSTEXT, with texts that came in several pieces put together."""

from collections import deque
from dataclasses import dataclass

from foundation.mavlink import dialect

WARNING = dialect.MAV_SEVERITY_WARNING  # 4; smaller is worse
KEPT = 50
PIECE = 50  # characters that one STATUSTEXT holds


@dataclass(frozen=True, slots=True)
class Said:
    """One text."""

    time_us: int  # µs, the vehicle's clock at the newest telemetry before it
    severity: int  # MAV_SEVERITY
    text: str


@dataclass(frozen=True, slots=True)
class _Open:
    """A text of which a piece may still be missing."""

    text_id: int
    severity: int
    time_us: int
    text: str


class StatusTexts:
    """The newest texts of one autopilot."""

    def __init__(self) -> None:
        self.newest: deque[Said] = deque(maxlen=KEPT)
        self._open: _Open | None = None

    def take(self, message: dialect.MAVLink_message, time_us: int) -> None:
        """Take in a STATUSTEXT. A full piece may have a successor or be the last: another text, or `since`, ends it."""
        text = _plain(message.text)
        if self._open is not None and (message.id != self._open.text_id or message.chunk_seq == 0):
            self._complete()
        before = self._open.text if self._open is not None else ""
        if message.id and len(text) >= PIECE:
            self._open = _Open(message.id, message.severity, time_us, before + text)
        else:
            self._open = None
            self._keep(message.severity, time_us, before + text)

    def _complete(self) -> None:
        if self._open is not None:
            self._keep(self._open.severity, self._open.time_us, self._open.text)
            self._open = None

    def _keep(self, severity: int, time_us: int, text: str) -> None:
        self.newest.append(Said(time_us, severity, " ".join(text.split())))

    def since(self, time_us: int) -> str:
        """Return the warnings and worse that were said from then on, in order, joined; empty when there was none."""
        self._complete()
        texts = [said.text for said in self.newest if said.time_us >= time_us and said.severity <= WARNING]
        return "; ".join(dict.fromkeys(texts))


def _plain(text: str | bytes) -> str:
    decoded = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return decoded.split("\0", 1)[0]
