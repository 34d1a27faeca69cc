"""What the loggers' processes are told when they start."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggerConfig:
    """A logger that measures the truth in an episode's world."""

    episode: str  # id, or a record's file
    folder: str  # of the episode's logs
    truth: str  # URL of the truth bus
    telemetry: tuple[str, ...]  # URLs, one of each drone's autopilot
    airframe: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateLoggerConfig:
    """A logger that keeps what an autopilot says of itself."""

    folder: str
