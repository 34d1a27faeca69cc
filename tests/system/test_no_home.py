"""A user without a home folder, as in many containers: shipped maps and kernels work without a traceback."""

import os
import pwd
import subprocess
import sys

import pytest

from dronecats.report.leaderboard import submission
from episodes.maps import user
from foundation.errors import UsageError

HOMELESS = """
import pwd, sys
def nobody(uid): raise KeyError(uid)
pwd.getpwuid = nobody
from dronecats.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
FOLDERS = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "NUMBA_CACHE_DIR", user.FOLDER)


@pytest.fixture
def homeless(monkeypatch):
    def nobody(uid):
        raise KeyError(uid)

    for name in FOLDERS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", nobody)


@pytest.mark.parametrize("words", [["maps", "list"], ["episodes", "list"], ["models", "list"]], ids=" ".join)
def test_shipped_items_are_listed(words):
    environment = {name: value for name, value in os.environ.items() if name not in FOLDERS}
    command = [sys.executable, "-c", HOMELESS, *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def test_the_kernel_cache_is_off():
    code = HOMELESS.split("from dronecats")[0] + "from foundation import compiled; print(compiled.CAN_CACHE)"
    environment = {name: value for name, value in os.environ.items() if name not in FOLDERS}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "False", done.stderr


def test_the_folder_of_user_maps_is_a_usage_error(homeless, monkeypatch):
    assert user.names() == []
    with pytest.raises(UsageError, match=user.FOLDER):
        user.folder()
    monkeypatch.setenv(user.FOLDER, "~/maps")
    with pytest.raises(UsageError, match=user.FOLDER):
        user.folder()


def test_machine_folders_are_listed_without_a_home(homeless):
    assert list(submission._machine_folders([]))
