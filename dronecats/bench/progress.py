"""How far a campaign is: counts as flights end, and one line that says them. Pure: all times are the caller's."""

from dataclasses import dataclass, field

from dronecats.agent.models.ledger import Spent
from dronecats.judge.statistics.shares import known_share
from foundation.run_folder.results import SCORED, Result
from foundation.wording import counted

HOUR_S = 3600.0


@dataclass(slots=True)
class Progress:
    """What has come of the flights so far; `before` of them were there when this sitting began."""

    total: int
    before: int = 0
    outcomes: dict[str, list[bool]] = field(default_factory=dict)  # successes of the scored flights, by episode
    errors: int = 0
    retries: int = 0
    flown: int = 0  # flights of this sitting, those that are flown once more included

    @property
    def solved(self) -> int:
        """Flights that succeeded."""
        return sum(map(sum, self.outcomes.values()))

    @property
    def failed(self) -> int:
        """Flights that failed."""
        return sum(map(len, self.outcomes.values())) - self.solved

    @property
    def done(self) -> int:
        """Episodes of which something has come, errors included."""
        return self.solved + self.failed + self.errors

    def stored(self, result: Result) -> None:
        """Take in what came of a flight before this sitting."""
        self.before += 1
        self._count(result)

    def came(self, result: Result, *, again: bool) -> None:
        """Take in what came of a flight; `again`: it did not move and is flown once more."""
        self.flown += 1
        if again:
            self.retries += 1
        else:
            self._count(result)

    def per_hour(self, wall_s: float) -> float:
        """Return how many flights have ended an hour of this sitting, which has lasted `wall_s`."""
        return self.flown * HOUR_S / wall_s if wall_s > 0.0 else 0.0

    def left_s(self, wall_s: float) -> float | None:
        """Return how many wall seconds are left at this pace; None while nobody knows."""
        return (self.total - self.done) * wall_s / self.flown if self.flown else None

    def line(self, wall_s: float, spent: Spent | None = None, left_usd: float | None = None) -> str:
        """Return it all in one line; `left_usd`: what is left is going to cost, None where that is not known."""
        told = [f"{self.done}/{self.total}"]
        left_s = self.left_s(wall_s)
        if left_s is not None and self.done < self.total:
            told.append(f"{_clock(left_s)} left, {self.per_hour(wall_s):.0f} an hour")
        if self.outcomes:  # the interval is that of the table: episodes are the unit
            known = known_share(list(self.outcomes.values()))
            told.append(f"SR {known.share:.0%} ({known.low:.0%}–{known.high:.0%})")
        told.append(f"{self.solved} solved, {self.failed} failed, {counted(self.errors, 'error')}")
        if self.retries:
            told.append(counted(self.retries, "retry", "retries"))
        if spent is not None and spent.questions:
            usd = f", ${spent.usd:.2f}" if spent.usd else ""
            usd += f" of about ${spent.usd + left_usd:.2f}" if usd and left_usd else ""
            told.append(f"{spent.tokens:,} tokens{usd}")
        return "; ".join(told)

    def _count(self, result: Result) -> None:
        if result.outcome in SCORED:
            self.outcomes.setdefault(result.episode, []).append(result.outcome == "success")
        else:
            self.errors += 1


def _clock(seconds: float) -> str:
    minutes, s = divmod(max(1, round(seconds)), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min {s:02d} s" if minutes else f"{s} s"
