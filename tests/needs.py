"""Programs, packages and files that some tests need and a machine may lack, each with a remedy."""

import importlib.util
import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass

import pytest

SYSTEM_PYTHON = "/usr/bin/python3"  # GStreamer's bindings come with the system, not from PyPI
GSTREAMER = (
    "import gi; gi.require_version('GstRtspServer', '1.0'); gi.require_version('Gst', '1.0');"
    "from gi.repository import Gst, GstRtspServer; Gst.init(None);"
    "assert all(map(Gst.ElementFactory.find, ('x264enc', 'rtph264pay', 'appsrc')))"
)
RTSP_PACKAGES = (
    "python3-gi gir1.2-gst-rtsp-server-1.0 "
    "gstreamer1.0-plugins-base gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly"
)
CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@dataclass(frozen=True)
class Need:
    """Something that a test needs."""

    missing: str  # the reason of a skipped test
    remedy: str  # the command that enables the test
    is_there: Callable[[], object]


def chromium() -> str | None:
    """Return the path of a Chromium that chromedriver can drive; None without one."""
    found = next((path for name in CHROMIUM if (path := shutil.which(name))), None)
    return found if shutil.which("chromedriver") else None


def _gstreamer() -> bool:
    try:
        return subprocess.run([SYSTEM_PYTHON, "-c", GSTREAMER], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def _variable(name: str, value: str, tests: str) -> Need:
    return Need(f"{name} is not set", f"{name}={value} pytest {tests}", lambda: os.environ.get(name))


NEEDS = {
    "browser": Need("no Chromium with chromedriver", "apt install chromium chromium-driver", chromium),
    "latex": Need(
        "no pdflatex", "apt install texlive-latex-base texlive-latex-recommended", lambda: shutil.which("pdflatex")
    ),
    "rtsp": Need("no RTSP server", f"apt install {RTSP_PACKAGES}", _gstreamer),
    "torch": Need("no PyTorch", 'pip install "dronecats[train]"', lambda: importlib.util.find_spec("torch")),
    "user": Need("root may write anywhere", "run the tests as an ordinary user", lambda: os.geteuid() != 0),
    "lerobot": _variable("DRONECATS_LEROBOT_PYTHON", "PYTHON_WITH_LEROBOT", "tests/report/export/test_lerobot.py"),
    "litellm": _variable("DRONECATS_LITELLM", "LITELLM_COMMAND", "tests/system/test_other_server.py"),
    "px4": _variable("DRONECATS_PX4", "PX4_COMMAND", "tests/system/test_*_px4.py"),
    "openai-schema": _variable(
        "DRONECATS_OPENAI_SCHEMA", "openapi.json", "tests/agent/models/test_published_schema.py"
    ),
}


def needs(name: str) -> pytest.MarkDecorator:
    """Return the mark that skips a test where `name` of NEEDS is missing."""
    need = NEEDS[name]
    return pytest.mark.skipif(not need.is_there(), reason=reason(name))


def reason(name: str) -> str:
    """Return why a test is skipped and what enables it."""
    return f"{NEEDS[name].missing}; to enable: {NEEDS[name].remedy}"
