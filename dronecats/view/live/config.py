"""The configuration of the viewer process."""

from dataclasses import dataclass

from foundation.conditions import AS_BUILT, SceneConditions


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedWires:
    """A simulator that writes no run folder: the addresses of its streams, and its world."""

    episode: str  # id or record file of the episode, which defines the world
    drones: int
    truth: str  # URL of the truth bus
    conditions: SceneConditions = AS_BUILT
    telemetry: tuple[str, ...]  # URLs of MAVLink telemetry, one per autopilot; empty if no port is free


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerConfig:
    """The configuration of a page that shows the flights of a folder or of a simulator."""

    port: int  # local port of the page; if it is taken, the next free one
    hosts: tuple[str, ...] = ()  # host names that may open the page, in addition to the loopback names
    root: str = ""  # folder of a run or a benchmark, which need not exist yet
    wires: WatchedWires | None = None  # a simulator, instead of `root`
    title: str = ""  # title of the page
