"""The flight logs: one ULog file from arming to disarming (SDLOG_MODE), and the folder of these files.

A log holds the same values that the autopilot sends as telemetry.
"""

import contextlib
import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from autopilot.logging import ulog
from autopilot.logging.topics import TABLE, Readings, Sources, Topic
from autopilot.mavlink.status_makers import FLIGHT_SW_VERSION, TelemetrySource
from foundation.errors import UsageError

_NAME = re.compile(r"log(\d{3,6})\.ulg")


@dataclass(frozen=True, slots=True)
class LogFile:
    """One log file, finished or still being written."""

    id: int  # from 0 (the oldest log)
    path: Path
    size: int  # bytes
    time_utc: int  # s since 1970, when the file was last written to


def make_folder(folder: Path) -> None:
    """Create a folder of the vehicle unless it exists. Raises UsageError when that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"The folder {folder} cannot be created ({error.strerror}). Give one that can be written to."
        ) from error


class LogDirectory:
    """The folder with the logs of one vehicle: `log001.ulg`, `log002.ulg`, ….

    Creates the folder. Raises UsageError when that is impossible.
    """

    def __init__(self, folder: Path) -> None:
        make_folder(folder)
        self.folder = folder
        self.active: Path | None = None  # the log being written, which no client may change

    def _numbered(self) -> list[tuple[int, Path]]:
        logs = []
        try:
            for path in self.folder.iterdir():
                match = _NAME.fullmatch(path.name)
                if match is not None and path.is_file():
                    logs.append((int(match[1]), path))
        except OSError:  # for example, the folder was removed
            return []
        return sorted(logs)

    def next_path(self) -> Path:
        """Return the path of the next log, numbered after the last one."""
        numbered = self._numbered()
        return self.folder / f"log{numbered[-1][0] + 1 if numbered else 1:03d}.ulg"

    def logs(self) -> list[LogFile]:
        """Return every log, oldest first."""
        logs: list[LogFile] = []
        for _, path in self._numbered():
            try:
                stat = path.stat()
            except OSError:  # removed in between
                continue
            logs.append(LogFile(len(logs), path, stat.st_size, max(int(stat.st_mtime), 0)))
        return logs

    def make_room(self, limit: int) -> None:
        """Remove the oldest logs, so that with the next log there are at most `limit`; 0 removes none.

        PX4's SDLOG_DIRS_MAX, which gives `limit`, counts folders. Here it counts logs, because all are in one folder.
        """
        if limit > 0:
            self._remove(self.logs()[: 1 - limit or None])

    def erase(self) -> None:
        """Remove every log except the one being written. Files that the disk does not remove stay."""
        self._remove(self.logs())

    def _remove(self, logs: list[LogFile]) -> None:
        for log in logs:
            if log.path != self.active:
                with contextlib.suppress(OSError):
                    log.path.unlink()


FLUSH_US = 500_000  # µs between two writes to the disk: a killed process loses at most this much of the log
SYSTEM = "DroneCATS"

# Values of SDLOG_MODE. With any other value, and after the first log of BOOT_TO_DISARMING, a log runs from arming to
# disarming.
DISABLED, BOOT_TO_DISARMING, BOOT_TO_SHUTDOWN = -1, 1, 2


@dataclass(slots=True)
class _Logged:
    """One topic of the open log."""

    topic: Topic
    packer: ulog.DataPacker
    stamp: int = 0  # µs, time of the last logged sample


@dataclass(slots=True)
class _Group:
    """Topics that are logged at the same rate and times."""

    interval_us: int
    due_us: int
    members: list[_Logged]


class FlightLogWriter:
    """Writes the flight log. Call `tick` once per tick of the autopilot.

    If a write to the disk fails, the data are lost and the flight continues. `failed` is the reason of the last such
    error, else None. `unpacked` counts the samples that are not logged because a value does not fit its field.
    """

    def __init__(self, vehicle: TelemetrySource, directory: LogDirectory) -> None:
        self.directory = directory
        self.failed: str | None = None
        self.unpacked = 0
        self._vehicle = vehicle
        self._sources = Sources(
            vehicle,
            Readings(vehicle.state.sensors),
            Readings(vehicle.actuators) if vehicle.actuators is not None else None,
        )
        self._logged = [_Logged(topic, ulog.DataPacker(i, topic.fields)) for i, topic in enumerate(TABLE)]
        self._groups = [
            _Group(round(1e6 / rate), 0, [x for x in self._logged if x.topic.rate_hz == rate])
            for rate in sorted({topic.rate_hz for topic in TABLE}, reverse=True)
        ]
        self._state_group = next(g for g in self._groups if any(x.topic.name == "vehicle_status" for x in g.members))
        self._shown: tuple[Any, ...] | None = None  # newest logged vehicle_status
        self._was_armed = False
        self._has_flown = False  # whether the vehicle was armed and disarmed since boot
        self._file: int | None = None
        self._size = 0  # bytes of whole messages in the file
        self._pending = bytearray()
        self._flush_due_us = 0
        self._dropout_since_us: int | None = None
        self._parameters: dict[str, int | float] = {}
        self._suspended = False  # the log could not begin: no new attempt before the next arming

    def tick(self) -> None:
        """Begin, continue or end the log."""
        armed, mode = self._vehicle.commander.armed, self._vehicle.parameters["SDLOG_MODE"]
        self._has_flown |= self._was_armed and not armed
        self._was_armed = armed
        from_boot = mode == BOOT_TO_SHUTDOWN or (mode == BOOT_TO_DISARMING and not self._has_flown)
        wanted = mode != DISABLED and (armed or from_boot)
        if self._file is None:
            if not wanted:
                self._suspended = False
            elif not self._suspended:
                self._begin()
            if self._file is None:
                return
        self._write_due()
        if not wanted:
            self.close()
        elif self._vehicle.state.time_us >= self._flush_due_us:
            self._flush()

    def log_text(self, severity: int, words: str) -> None:
        """Put a text into the log, if one is open."""
        if self._file is not None:
            self._pending += ulog.text(severity, self._vehicle.state.time_us, words)

    def close(self) -> None:
        """End the log that is open, if any."""
        if self._file is None:
            return
        self._flush()
        os.close(self._file)
        self._file = None
        self.directory.active = None

    def _begin(self) -> None:
        path = self.directory.next_path()
        self.directory.make_room(int(self._vehicle.parameters["SDLOG_DIRS_MAX"]))
        self.failed, self._dropout_since_us, self._size = None, None, 0
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        except OSError as error:
            self.failed, self._suspended = error.strerror, True
            return
        self.directory.active = path
        now = self._vehicle.state.time_us
        self._parameters = dict(self._all_parameters())
        self._pending = bytearray(ulog.header(now))
        for part in self._definitions():
            self._pending += part
        for group in self._groups:
            group.due_us = now
        for logged in self._logged:
            logged.stamp = 0
        self._flush()
        if self.failed is not None:  # a log without its header cannot be read
            self.close()
            self._suspended = True
            path.unlink(missing_ok=True)

    def _definitions(self) -> Iterator[bytes]:
        vehicle = self._vehicle
        for topic in TABLE:
            yield ulog.definition(topic.name, topic.fields)
        yield ulog.information("sys_name", SYSTEM)
        yield ulog.information("ver_hw", vehicle.airframe.name)
        yield ulog.information("ver_sw_release", FLIGHT_SW_VERSION)
        yield ulog.information("ver_data_format", 1)
        for name, value in self._parameters.items():
            yield ulog.parameter(name, value)
        for number, topic in enumerate(TABLE):
            yield ulog.subscription(number, topic.name)

    def _all_parameters(self) -> Iterator[tuple[str, int | float]]:
        parameters = self._vehicle.parameters
        return ((name, parameters[name]) for name in parameters.names)

    def _write_due(self) -> None:
        vehicle, sources = self._vehicle, self._sources
        now, c = vehicle.state.time_us, vehicle.commander
        shown = (c.mode, c.intended, c.in_failsafe, c.landed, c.armed)
        if shown != self._shown:  # changes of state are logged when they happen
            self._shown = shown
            self._state_group.due_us = now
        fresh = False
        for group in self._groups:
            late = now - group.due_us
            if late < 0:
                continue
            group.due_us = group.due_us + group.interval_us if late < group.interval_us else now + group.interval_us
            if not fresh:
                sources.sensors.refresh()
                if sources.actuators is not None:
                    sources.actuators.refresh()
                fresh = True
            for logged in group.members:
                self._write(logged, now)

    def _write(self, logged: _Logged, now: int) -> None:
        topic = logged.topic
        if topic.stamp is not None:
            stamp = getattr(self._sources.sensors, topic.stamp)
            if stamp == logged.stamp:
                return
            logged.stamp = stamp
        values = topic.values(self._sources)
        if values is None:
            return
        try:
            self._pending += logged.packer.pack((now, *values))
        except (struct.error, OverflowError):  # a number that its field cannot hold
            self.unpacked += 1

    def _flush(self) -> None:
        """Write the pending data. If this fails, they are lost, and the next successful write records the dropout."""
        assert self._file is not None
        now = self._vehicle.state.time_us
        self._flush_due_us = now + FLUSH_US
        for name, value in self._all_parameters():
            if value != self._parameters[name]:
                self._parameters[name] = value
                self._pending += ulog.parameter(name, value)
        data = bytes(self._pending)
        self._pending.clear()
        if self._dropout_since_us is not None:
            data = ulog.dropout((now - self._dropout_since_us) // 1000) + data
        try:
            if os.write(self._file, data) != len(data):
                raise OSError(28, "the disk is full")
            self._size += len(data)
            self._dropout_since_us = None
        except OSError as error:
            self.failed = error.strerror
            if self._dropout_since_us is None:
                self._dropout_since_us = now - FLUSH_US
            with contextlib.suppress(OSError):  # remove a message that was written only in part
                os.ftruncate(self._file, self._size)
                os.lseek(self._file, self._size, os.SEEK_SET)
