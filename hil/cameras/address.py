"""Parses the address of a camera, and shows it in messages without the password."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl

from foundation.errors import UsageError

FORMS = "http://…, rtsp://…, v4l2:0, a video file or a folder of pictures"
_NAME = r"([\w-]*(?:pass|pwd|token|secret|key|auth|user|login)[\w-]*=)"
_SECRET_IN_PATH = re.compile(rf"{_NAME}[^&/\s]*", re.IGNORECASE)
_SECRET_IN_QUERY = re.compile(rf"{_NAME}[^&#\s]*", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Address:
    """The parts of an address."""

    kind: str  # http, rtsp, v4l2, video, folder
    place: str  # the URL, device or path to open
    options: Mapping[str, str]  # query after the ?; empty for http and rtsp, whose query stays in `place`


def parse(url: str) -> Address:
    """Return the parts of an address. Raises UsageError for an invalid one."""
    scheme, _, rest = url.partition("://")
    scheme = scheme.lower()
    if rest and scheme in ("http", "https"):
        return Address("http", url, {})
    if rest and scheme in ("rtsp", "rtsps"):
        return Address("rtsp", url, {})
    if url.startswith("v4l2:"):
        device, _, query = url.removeprefix("v4l2:").removeprefix("//").partition("?")
        if device.isdigit() or device.startswith("/dev/"):
            return Address("v4l2", f"/dev/video{device}" if device.isdigit() else device, dict(parse_qsl(query)))
        raise UsageError(f"camera {shown(url)!r} must be v4l2:0 or v4l2:/dev/video0")
    name, _, query = (rest if scheme == "file" else url).partition("?")
    path = Path(name)
    try:
        if path.is_dir():
            return Address("folder", name, dict(parse_qsl(query)))
        if path.is_file():
            return Address("video", name, {})
    except (OSError, ValueError):  # the text is too long for a path, or has a null byte
        pass
    raise UsageError(f"camera {shown(url)!r} is not a camera. Use {FORMS}")


def shown(url: str) -> str:
    """Return an address for messages, without the user, the password, and options that look like a secret.

    A password may contain any character, so everything up to the last @ is hidden.
    """
    scheme, separator, rest = url.partition("://")
    if separator and "@" in rest:
        rest = "***@" + rest.rpartition("@")[2]
    path, mark, query = rest.partition("?")
    return scheme + separator + _SECRET_IN_PATH.sub(r"\1***", path) + mark + _SECRET_IN_QUERY.sub(r"\1***", query)
