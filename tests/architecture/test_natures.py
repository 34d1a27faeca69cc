"""A test may only do what its nature (the marker unit, flight or process) allows."""

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
def test_a_unit_test_may_not_start_a_process_open_a_socket_or_render(action):
    with pytest.raises(NatureError):
        action()


@pytest.mark.flight
def test_a_flight_test_may_render_but_not_start_a_process():
    with pytest.raises(NatureError):
        run_process()
    with pytest.raises(AttributeError):  # the scene is None; rendering itself is allowed
        render()


@pytest.mark.process
def test_a_process_test_may_not_start_a_browser():
    run_process()
    with pytest.raises(NatureError):
        subprocess.run(["/nowhere/chromedriver"], check=True)


def test_every_path_exists(pytestconfig):
    assert [path for path in PATHS if not (pytestconfig.rootpath / path).exists()] == []
