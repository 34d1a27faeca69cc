"""Invalid cluster options are rejected before any flight."""

import re
import socket

import pytest

from dronecats.cli.main import main


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--address", "10.0.0.1:6379"], "--address .*--engine ray"),
        (["--engine", "ray", "--address", "somewhere"], "HOST:PORT .*'somewhere'"),
        (["--engine", "ray", "--address", "127.0.0.1:{free}"], "--address .*127.0.0.1"),
    ],
)
def test_invalid_cluster_options_and_unreachable_addresses_are_rejected(words, parts, tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as held:
        free = held.getsockname()[1]
    words = [word.format(free=free) for word in words]
    assert main(["bench", "residential-approaching-01", "--pilot", "oracle", "--out", str(tmp_path), *words]) == 2
    assert re.search(parts, capsys.readouterr().err)
