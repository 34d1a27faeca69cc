"""Compiles the kernels of a flight in parallel processes, on the first run of an installation.

numba compiles one function at a time in a process. Plant (vehicle physics), inner loop (estimator and controller) and
camera take about the same time. So the calling process compiles the inner loop, and two others compile plant and
camera. All three write to the cache of `foundation.compiled`, from which simulator and camera load their kernels.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import ExitStack
from typing import Any

import numba

from foundation.compiled import CAN_CACHE, ROOT, Kernel, cache_folder
from foundation.redaction import keyless_environment
from vehicles import airframe
from vehicles.multirotor import Multirotor, step

OTHERS_S = 60.0  # wall seconds to wait for the other processes; unfinished parts are compiled at their first call
CACHED = "*.nbi"  # numba's index file of one compiled function


def is_compiled() -> bool:
    """Return whether the cache has the compiled plant. Otherwise this run compiles for half a minute."""
    return CAN_CACHE and any(cache_folder().rglob(f"multirotor.step{CACHED}"))


def should_compile_in_parallel() -> bool:
    """Return whether to compile in parallel: the plant is not cached but can be, and there are several CPUs."""
    return CAN_CACHE and (os.cpu_count() or 1) > 1 and not is_compiled()


def compile_notice() -> str:
    """Return a note that this run compiles, and for how long, to append to a message; empty if all is compiled."""
    return "" if is_compiled() else "; the first run compiles them, which takes about half a minute"


def compile_all(core: Kernel[..., object], core_arguments: Iterable[Any]) -> None:
    """Compile and cache the kernel `core` for the types of `core_arguments`, and in parallel plant and camera.

    A process that fails is not an error: its kernels are compiled at their first call.
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
    """Return the numba types of a kernel's arguments."""
    return tuple(numba.typeof(argument) for argument in arguments)


def compile_plant() -> None:
    """Compile the plant, once for all airframes and maps, because they differ in values, not in types."""
    plant = Multirotor(airframe.load("x500"), seed=0, origin=(0.0, 0.0, 0.0))
    step.compile(signature(plant.kernel_args))


def compile_camera() -> None:
    """Compile the renderer, once for all maps and picture sizes, because they differ in values, not in types."""
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
