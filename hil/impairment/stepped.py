"""A bad wire within one process, in vehicle time: what enters at a tick arrives at a later one, the same every time."""

from collections.abc import Callable

from hil.impairment.channel import Counts, Impairment
from hil.impairment.one_way import PERFECT, OneWay
from hil.link.transport import Transport


class SteppedWire(Transport):
    """The agent's end of a wire that is perfect until it is impaired. Whoever reads from it when it is dry `pump`s.

    It carries at ticks: so a delay is lengthened to whole ones.
    """

    def __init__(
        self,
        url: str,
        take: Callable[[], bytes],
        give: Callable[[bytes], None],
        pump: Callable[[], None],
        now_s: Callable[[], float],
        seed: int,
        close: Callable[[], None] = lambda: None,
    ) -> None:
        """`take` returns what the vehicle has said, `give` lets it hear; `now_s` reads its clock, which `pump` moves.

        `pump` calls `step` once a tick.
        """
        self.url = url
        self._take, self._give, self._pump, self._now_s = take, give, pump, now_s
        self._up, self._down = OneWay(PERFECT, seed, "up"), OneWay(PERFECT, seed, "down")
        self._heard = bytearray()
        self._close = close

    def time_s(self) -> float:
        return self._now_s()

    def close(self) -> None:
        self._close()

    @property
    def counts(self) -> tuple[Counts, Counts]:
        """What has become of the frames, to the vehicle and from it, since the wire was last impaired or mended."""
        return self._up.channel.counts, self._down.channel.counts

    def impair(self, up: Impairment, down: Impairment, seconds: float) -> None:
        """From now on and for so long be impaired: `up` to the vehicle, `down` from it."""
        self._up.impair(up, seconds)
        self._down.impair(down, seconds)

    def step(self, said: bytes = b"") -> None:
        """Carry, once a tick, what has been said meanwhile; `said` by the vehicle has been taken already."""
        self.send(b"")
        self._hear(said)

    def receive(self, timeout_s: float) -> bytes:
        """Return what has arrived; b'' when nothing did within `timeout_s` of the vehicle's time."""
        due_s = self._now_s() + timeout_s
        self._hear()
        while not self._heard and self._now_s() < due_s:
            self._pump()
        data = bytes(self._heard)
        self._heard.clear()
        return data

    def send(self, data: bytes) -> None:
        for unit in self._up.carry(self._now_s(), data):
            self._give(unit)

    def _hear(self, said: bytes = b"") -> None:
        for unit in self._down.carry(self._now_s(), said + self._take()):
            self._heard += unit
