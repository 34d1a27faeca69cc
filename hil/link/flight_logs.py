"""Lists and downloads the flight logs of an autopilot, with MAVSDK over MAVLink."""

import queue
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foundation.errors import LinkError, UsageError
from foundation.redaction import redacted

SCHEMES = {  # scheme of our URLs -> MAVSDK's scheme
    "udpin": "udpin", "udp": "udpin", "udpout": "udpout", "tcp": "tcpout", "tcpout": "tcpout", "serial": "serial",
}  # fmt: skip
ULOG_MAGIC = bytes([0x55, 0x4C, 0x6F, 0x67, 0x01, 0x12, 0x35])
STALL_S = 20.0  # s without progress until a download ends with an error


@dataclass(frozen=True, slots=True)
class FlightLog:
    """One log in the autopilot's list."""

    number: int  # id of the log on board
    date: str  # UTC time when the log was written, by the autopilot's clock; 1970 if the clock was not set
    size_bytes: int


class LogStore:
    """The logs of one autopilot."""

    def __init__(self, files: Any, url: str) -> None:
        self._files, self._url = files, url

    def entries(self) -> list[FlightLog]:
        """Return the logs on board, oldest first. Raises LinkError if the autopilot does not list them."""
        from mavsdk.plugins.log_files import LogFilesError, LogFilesResult

        try:
            listed = self._files.get_entries()
        except LogFilesError as refused:
            if refused.result == LogFilesResult.NO_LOGFILES:
                return []
            raise LinkError(f"the autopilot on {self._url} lists no logs: {refused.result.name}") from None
        logs = [FlightLog(int(e.id), str(e.date), int(e.size_bytes)) for e in listed]
        return sorted(logs, key=lambda log: (log.date, log.number))

    def fetch(self, log: FlightLog, folder: Path, progress: Callable[[float], None] = lambda share: None) -> Path:
        """Download a log into a folder and return its file. `progress` gets the share (0 … 1) that has arrived.

        Raises UsageError if the file exists or cannot be written, LinkError if the download fails.
        """
        stamp = "".join(c for c in log.date if c.isalnum())
        file = folder / f"log{log.number:03d}-{stamp}.ulg"
        part = file.with_name(file.name + ".part")
        if file.exists():
            raise UsageError(f"{file} already exists. Move it away, or choose another --out")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            part.unlink(missing_ok=True)
        except OSError as error:
            raise UsageError(f"{folder} cannot be written: {error.strerror}") from None
        self._download(log, part, progress)
        with part.open("rb") as data:
            if data.read(len(ULOG_MAGIC)) != ULOG_MAGIC:
                raise LinkError(f"the file from the autopilot is not a ULog. It stays in {part}")
        part.rename(file)
        return file

    def _download(self, log: FlightLog, part: Path, progress: Callable[[float], None]) -> None:
        from mavsdk.plugins.log_files import Entry, LogFilesResult

        updates: queue.Queue[tuple[Any, float]] = queue.Queue()  # MAVSDK calls back from its own thread
        entry = Entry(log.number, log.date, log.size_bytes)
        self._files.download_log_file_async(
            entry, str(part), lambda result, data, _: updates.put((result, data.progress))
        )
        share = -1.0
        while True:
            try:
                result, reached = updates.get(timeout=STALL_S)
            except queue.Empty:
                self._files.cancel_download_log_file()
                raise LinkError(f"the download of log {log.number} has stopped for {STALL_S:g} s. Try again") from None
            if result == LogFilesResult.SUCCESS:
                progress(1.0)
                return
            if result != LogFilesResult.NEXT:
                raise LinkError(f"the download of log {log.number} failed: {result.name}")
            if reached >= share + 0.01:
                share = reached
                progress(reached)


@contextmanager
def log_store(url: str, timeout_s: float = 15.0) -> Iterator[LogStore]:
    """Connect to an autopilot as a ground station and yield its logs.

    Raises UsageError for an invalid URL or a port in use, LinkError if no autopilot answers.
    """
    from mavsdk.component_type import ComponentType
    from mavsdk.connection_result import ConnectionResult
    from mavsdk.logging import log_subscribe
    from mavsdk.mavsdk import Configuration, Mavsdk
    from mavsdk.plugins.log_files import LogFiles

    shown, mavsdk_url = redacted(url), _mavsdk_url(url)
    log_subscribe(lambda level, text, file, line: True)  # hides MAVSDK's log, which our own errors replace
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    try:
        result = mavsdk.add_any_connection(mavsdk_url)
        if result != ConnectionResult.SUCCESS:
            raise UsageError(f"--connect {shown} cannot be opened: {result.name.lower().replace('_', ' ')}")
        system = mavsdk.first_autopilot(timeout_s)
        if system is None:
            raise LinkError(
                f"no MAVLink heartbeat of an autopilot on {shown} within {timeout_s:g} s."
                " Check that the vehicle or simulator runs, and that the URL is right"
            )
        yield LogStore(LogFiles(system), shown)
    finally:
        mavsdk.destroy()


def _mavsdk_url(url: str) -> str:
    scheme, separator, rest = url.partition("://")
    if not separator or not rest or scheme not in SCHEMES:
        forms = "udpin://HOST:PORT, udpout://HOST:PORT, tcp://HOST:PORT or serial://DEVICE:BAUD"
        raise UsageError(f"--connect '{redacted(url)}' is not a link. Use {forms}")
    return f"{SCHEMES[scheme]}://{rest}"
