"""An episode that was flown, as its folder tells: what every metric is a function of."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dronecats.judge.episode import outcome
from dronecats.judge.measured import declarations
from dronecats.judge.metrics.flown_step import FlownStep, flown_steps
from dronecats.judge.verdict import Measured, in_order
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder import layout
from foundation.run_folder.reading import Logs, json_object, read
from foundation.run_folder.results import SCORED, Verdict


@dataclass(frozen=True)
class FlownEpisode:
    """One flight of one episode. Nothing in it comes from anywhere but its folder."""

    folder: Path
    record: dict[str, Any]  # the record that was flown, as episode.json holds it; {}: there is none
    logs: Logs
    delta_m: float = RADIUS_M  # m, success radius
    cap_s: float = CAP_S  # s, declarations after it do not count

    @property
    def id(self) -> str:
        """The record's id, of a folder without one its name."""
        return str(self.record.get("id", self.folder.resolve().name))

    @property
    def cell(self) -> str:
        """approaching, searching, tracking, search-and-track or commanding; empty: not known."""
        return str(self.record.get("cell", ""))

    @property
    def map(self) -> str:
        """The map's name; empty: not known."""
        return str(self.record.get("map", ""))

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict, derived anew from the logs."""
        return outcome(self.logs, self.delta_m, self.cap_s)

    @property
    def scored(self) -> bool:
        """Whether it is somebody's success or failure."""
        return self.verdict.outcome in SCORED

    @cached_property
    def steps(self) -> tuple[FlownStep, ...]:
        """Its decisions, in the order of the log."""
        return flown_steps(self.logs, self.cap_s)

    @cached_property
    def declarations(self) -> tuple[Measured, ...]:
        """Those that count, pooled over the fleet, in their order; nothing where nobody knew the truth."""
        return tuple(in_order(declarations(self.logs, self.cap_s), self.cap_s)) if self.logs.true else ()


def flown_episode(folder: Path, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> FlownEpisode:
    """Return the episode of a folder. Raises UsageError when a log is missing or damaged."""
    return FlownEpisode(folder, json_object(folder / layout.EPISODE) or {}, read(folder), delta_m, cap_s)
