"""Compiles the kernels and builds the maps, so that the workers of a test run find them in the user's cache folder.

Otherwise every worker would compile and build them.
"""

from dronecats.bench.worker import compile_all
from episodes.camera.renderer.renderer import Renderer
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel

EPISODES = ("residential-approaching-01", "campus-approaching-01", "blocks-commanding-01")  # one on each map


def prepare() -> None:
    """Compile the kernels of flight and camera, and store each map with what a camera needs of it."""
    compile_all()
    for name in EPISODES:
        Renderer(World(catalogue.load(name)).filmed, CameraModel(64, 36)).close()


if __name__ == "__main__":
    prepare()
