"""Options for the paths of the examples and of the older client, which are not in this repository."""

from pathlib import Path


def pytest_addoption(parser):
    group = parser.getgroup("compatibility")
    group.addoption("--examples", type=Path, default=None, help="folder `examples` of a MAVSDK-Python checkout")
    group.addoption("--mavsdk3", type=Path, default=None, help="python of an environment with mavsdk 3 and its extras")
    group.addoption("--at-once", type=int, default=2, help="examples flown at the same time, where that is possible")
