"""What the viewer's process is told when it starts."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedWires:
    """A simulator that writes no folder."""

    episode: str  # id, or a record's file, whose world it is
    drones: int
    truth: str  # URL of the truth bus
    telemetry: tuple[str, ...]  # URLs, one of each drone's autopilot; none where nobody has a port to spare


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerConfig:
    """A page over the flights of a folder, or over a simulator's wires."""

    port: int  # of the page on this machine; the next one that is free where it is taken
    hosts: tuple[str, ...] = ()  # host names beside the loopback ones under which the page opens
    root: str = ""  # a run's folder, or a benchmark's, which need not be there yet
    wires: WatchedWires | None = None  # … and no folder
    title: str = ""  # of what is flown, for the page's heading
