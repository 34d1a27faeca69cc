"""The configuration of the viewer process."""

from dataclasses import dataclass

from foundation.conditions import AS_BUILT, SceneConditions


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedWires:
    """The addresses of a simulator that writes no folder."""

    episode: str  # id, or a record's file, whose world it is
    drones: int
    truth: str  # URL of the truth bus
    conditions: SceneConditions = AS_BUILT
    telemetry: tuple[str, ...]  # URLs, one per autopilot; none without a free port


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerConfig:
    """A page of the flights of a folder, or of a simulator."""

    port: int  # of the page on this machine; the next free one when it is taken
    hosts: tuple[str, ...] = ()  # host names beside the loopback ones under which the page opens
    root: str = ""  # a run's folder, or a benchmark's, which may not exist yet
    wires: WatchedWires | None = None  # in place of `root`
    title: str = ""  # of the page
