"""Compiles what a flight needs in several processes, on the first run of an installation.

numba compiles one function at a time in a process. The plant, the inner loop and the camera take about as long as one
another: the first run compiles the inner loop, and one more process each the plant and the camera. All leave their work
in the cache of `foundation.compiled`, where `dronecats.flight.sitl.fused` and the camera find it.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import ExitStack
from typing import Any

import numba

from foundation.compiled import KEEPS, ROOT, Kernel, cache_folder
from foundation.redaction import keyless_environment
from vehicles import airframe
from vehicles.multirotor import Multirotor, step

OTHERS_S = 60.0  # wall seconds after which the parts that are not ready are compiled where they are called
CACHED = "*.nbi"  # numba's index of what it has compiled of one function


def is_compiled() -> bool:
    """Return whether a flight finds its plant compiled; else this run compiles for half a minute."""
    return KEEPS and any(cache_folder().rglob(f"multirotor.step{CACHED}"))


def cold() -> bool:
    """Return whether the plant has to be compiled, by a second core if there is one, and can be kept."""
    return KEEPS and (os.cpu_count() or 1) > 1 and not is_compiled()


def duration() -> str:
    """Return what a message adds to "loading …": how long this run compiles, if it does."""
    return "" if is_compiled() else "; the first run compiles them, which takes about half a minute"


def compile_all(core: Kernel[..., object], core_arguments: Iterable[Any]) -> None:
    """Compile and cache `core` (a kernel) for the arguments it will have, and beside it the plant and the camera.

    A process that fails costs its time only: what it leaves undone is compiled when it is called.
    """
    with ExitStack() as stack:
        children = [stack.enter_context(_started(part)) for part in TASKS]
        try:
            core.compile(signature(core_arguments))
            deadline_s = time.monotonic() + OTHERS_S
            for child in children:
                child.wait(max(0.0, deadline_s - time.monotonic()))
        except BaseException as stopped:
            for child in children:
                child.kill()
            if not isinstance(stopped, subprocess.TimeoutExpired):
                raise


def _started(part: str) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-m", "dronecats.flight.sitl.compile_ahead", part],
        cwd=ROOT,
        env=keyless_environment(os.environ) | {"NUMBA_CACHE_DIR": str(cache_folder().parents[1].resolve())},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def signature(arguments: Iterable[Any]) -> tuple[numba.types.Type, ...]:
    """Return the types that a kernel is compiled for when it is called with these arguments."""
    return tuple(numba.typeof(argument) for argument in arguments)


def compile_plant() -> None:
    """Compile the plant. One vehicle stands for all: airframes and maps differ in values, not in types."""
    plant = Multirotor(airframe.load("x500"), seed=0, origin=(0.0, 0.0, 0.0))
    step.compile(signature(plant.kernel_args))


def compile_camera() -> None:
    """Compile the renderer. One map and a small picture stand for all: maps differ in values, not in types."""
    from episodes.camera.renderer.renderer import Renderer
    from episodes.records import catalogue
    from episodes.world.world import World
    from foundation.camera import CameraModel, camera_pose

    world, camera = World(catalogue.load("blocks-commanding-01")), CameraModel(64, 36)
    renderer = Renderer(world.filmed, camera)
    renderer.picture(camera_pose(world.scene.spawn_ned, (1.0, 0.0, 0.0, 0.0), camera), world.moved(0.0))
    renderer.close()


TASKS = {"plant": compile_plant, "camera": compile_camera}

if __name__ == "__main__":
    TASKS[sys.argv[1]]()
