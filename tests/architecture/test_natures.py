"""The check of test natures stops a test that exceeds its nature."""

import socket
import subprocess
import sys

import pytest

from episodes.camera.renderer.renderer import Renderer
from tests.natures import PATHS, NatureError


def run_process():
    subprocess.run([sys.executable, "-c", ""], check=True)


def open_socket():
    with socket.socket() as opened:
        opened.bind(("127.0.0.1", 0))


def render():
    Renderer(None, None)  # type: ignore[arg-type]


@pytest.mark.unit
@pytest.mark.parametrize("action", [run_process, open_socket, render])
def test_a_unit_test_is_stopped(action):
    with pytest.raises(NatureError):
        action()


@pytest.mark.flight
def test_a_flight_starts_no_process_and_may_render():
    with pytest.raises(NatureError):
        run_process()
    with pytest.raises(AttributeError):  # of a scene that is None
        render()


@pytest.mark.process
def test_a_process_starts_no_browser():
    run_process()
    with pytest.raises(NatureError):
        subprocess.run(["/nowhere/chromedriver"], check=True)


def test_every_path_exists(pytestconfig):
    assert [path for path in PATHS if not (pytestconfig.rootpath / path).exists()] == []
