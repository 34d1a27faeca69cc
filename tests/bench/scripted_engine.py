"""An engine without simulation: it writes the folders of flights from a script."""

import json
from collections import deque
from collections.abc import Callable

from dronecats.bench.engine import Sortie
from dronecats.judge.episode import write_verdict
from foundation.run_folder.results import Result
from tests.judge.episode_logs import BEGIN, END, decision, frame, pose, write

STUCK, NEAR, MOVED, SOLVED, BROKEN, SPENT = "stuck", "stuck and solved", "moved", "solved", "broken", "spent"
REJECTED = "rejected"
REASONS = {BROKEN: "error", SPENT: "budget", REJECTED: "rejected"}
Script = Callable[[Sortie, int], str]  # (flight, number of the attempt at its episode in its run, from 1) → result


class ScriptedEngine:
    """Ends flights in last-in, first-out order, so that no test relies on an order."""

    def __init__(self, script: Script) -> None:
        self._script = script
        self._up: deque[Sortie] = deque()
        self.flown: list[str] = []  # RUN/EPISODE of each flight, in the order of their start
        self.most = 0  # largest number of flights in the air at the same time
        self.closed = False

    def begin(self, sortie: Sortie) -> None:
        self._up.append(sortie)
        self.flown.append(f"{sortie.folder.parent.name}/{sortie.folder.name}")
        self.most = max(self.most, len(self._up))

    def landed(self) -> tuple[Sortie, Result]:
        sortie = self._up.pop()
        what = self._script(sortie, self.flown.count(f"{sortie.folder.parent.name}/{sortie.folder.name}"))
        return sortie, fly(sortie, what)

    def close(self) -> None:
        self.closed = True


def fly(sortie: Sortie, what: str) -> Result:
    """Write the folder of a flight with this result, and return the result."""
    assert not list(sortie.folder.glob("*.jpg"))
    (sortie.folder / "episode.json").write_text(json.dumps(sortie.flight.record))
    if what in REASONS:
        write_verdict(sortie.folder)
        return Result(episode=sortie.folder.name, outcome="error", error="because", reason=REASONS[what])
    far_m = 0.4 if what in (STUCK, NEAR) else 20.0
    trace = [pose(t / 2, 12.0, place=[far_m * (t % 2), 0.0, -2.0]) for t in range(601)]
    near_m = 1.0 if what in (SOLVED, NEAR) else 12.0
    decisions = [{**decision(0, 1, 3.0), "rate_hz": None}, {**decision(1, 2, 6.0), "rate_hz": 0.5}]
    write(sortie.folder, decisions, [BEGIN, *trace, frame(1, 2.5, near_m), frame(2, 5.5, near_m), END])
    verdict = write_verdict(sortie.folder)
    return Result(episode=sortie.folder.name, outcome=verdict.outcome)
