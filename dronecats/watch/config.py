"""What the viewer's process is told when it starts."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerConfig:
    """A page over the flights of a folder."""

    root: str  # a run's folder, or a benchmark's, which need not be there yet
    port: int  # of the page on this machine; the next one that is free where it is taken
    title: str = ""  # of what is flown, for the page's heading
