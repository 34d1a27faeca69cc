"""The first run of an installation compiles the plant in a second process while the first compiles the autopilot.

numba compiles one function at a time in a process, and plant and inner loop take about as long as one another. Both
processes leave their work in the cache of `foundation.compiled`, where `dronecats.sitl.fused` finds it.
"""

import os
import subprocess
import sys
from collections.abc import Iterable
from typing import Any

import numba

from foundation.compiled import KEEPS, ROOT, Kernel, cache_folder
from foundation.redaction import keyless_environment
from vehicles import airframe
from vehicles.multirotor import Multirotor, step

PLANT_S = 60.0  # wall seconds after which the plant is compiled here instead
CACHED = "*.nbi"  # numba's index of what it has compiled of one function


def cold() -> bool:
    """Return whether the plant has to be compiled, by a second core if there is one, and can be kept."""
    return KEEPS and (os.cpu_count() or 1) > 1 and not any(cache_folder().rglob(f"multirotor.step{CACHED}"))


def compile_both(core: Kernel[..., object], core_arguments: Iterable[Any]) -> None:
    """Return when the plant and `core` (a kernel) are compiled and cached for the arguments they will have.

    A second process that fails costs its time only: what it leaves undone is compiled when it is called.
    """
    with subprocess.Popen(
        [sys.executable, "-m", "dronecats.sitl.compile_ahead"],
        cwd=ROOT,
        env=keyless_environment(os.environ) | {"NUMBA_CACHE_DIR": str(cache_folder().parents[1].resolve())},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as other:
        try:
            core.compile(signature(core_arguments))
            other.wait(PLANT_S)
        except BaseException as stopped:
            other.kill()
            if not isinstance(stopped, subprocess.TimeoutExpired):
                raise


def signature(arguments: Iterable[Any]) -> tuple[numba.types.Type, ...]:
    """Return the types that a kernel is compiled for when it is called with these arguments."""
    return tuple(numba.typeof(argument) for argument in arguments)


def compile_plant() -> None:
    """Compile the plant. One vehicle stands for all: airframes and maps differ in values, not in types."""
    plant = Multirotor(airframe.load("x500"), seed=0, origin=(0.0, 0.0, 0.0))
    step.compile(signature(plant.kernel_args))


if __name__ == "__main__":
    compile_plant()
