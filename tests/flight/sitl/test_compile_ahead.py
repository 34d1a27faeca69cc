"""A second process must compile the functions that the first one calls, or the first one compiles them again."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from dronecats.flight.sitl import compile_ahead
from foundation.terrain import FLAT, HeightField
from vehicles import airframe
from vehicles.multirotor import Multirotor

ORIGIN = (47.4, 8.5, 488.0)


def test_the_plant_of_every_airframe_and_map_has_the_same_types() -> None:
    hills = HeightField(-10.0, -10.0, 5.0, np.zeros((5, 7)))
    standard = Multirotor(airframe.load("x500"), seed=0, origin=ORIGIN)
    for name in airframe.names():
        for terrain in (FLAT, hills):
            other = Multirotor(airframe.load(name), seed=3, origin=ORIGIN, terrain=terrain)
            assert compile_ahead.signature(other.kernel_args) == compile_ahead.signature(standard.kernel_args)


def test_compilation_is_parallel_until_the_plant_is_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_ahead, "cache_folder", lambda: tmp_path / "kernels")
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(compile_ahead, "CAN_CACHE", True)
    assert compile_ahead.should_compile_in_parallel()
    folder = tmp_path / "kernels" / "vehicles"
    folder.mkdir(parents=True)
    assert compile_ahead.should_compile_in_parallel()
    monkeypatch.setattr(compile_ahead, "CAN_CACHE", False)
    assert not compile_ahead.should_compile_in_parallel()  # nothing would be cached
    monkeypatch.setattr(compile_ahead, "CAN_CACHE", True)
    (folder / "multirotor.step-12.py311.nbi").touch()
    assert not compile_ahead.should_compile_in_parallel()


KERNELS = """
import sys
from dronecats.flight.sitl import camera, compile_ahead, episode_world
from foundation.camera import CameraModel

def compiled():
    modules = [module for name, module in sys.modules.items() if name.startswith("episodes.camera.renderer.")]
    kernels = {id(k): k for module in modules for k in vars(module).values() if hasattr(k, "signatures")}
    return {kernel.__name__: kernel.signatures for kernel in kernels.values()}

compile_ahead.compile_camera()
before = compiled()
assert any(before.values())
world = episode_world.load_world("residential-approaching-01", "x500", 1)
camera._warm.clear()
camera.WorldCamera(world, CameraModel(), lambda data: None).warm_up()
assert compiled() == before
"""


@pytest.mark.slow
def test_the_camera_of_another_map_and_size_has_the_same_types() -> None:
    subprocess.run([sys.executable, "-c", KERNELS], check=True)


def test_compilation_succeeds_even_if_the_second_process_cannot_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    double = numba.njit(lambda x: 2.0 * x)
    compile_ahead.compile_all(double, (1.5,))
    assert double.signatures == [(numba.float64,)]


def test_compiled_kernels_are_detected(monkeypatch, tmp_path):
    monkeypatch.setattr(compile_ahead, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(compile_ahead, "CAN_CACHE", True)
    assert not compile_ahead.is_compiled()
    (tmp_path / "vehicles").mkdir()
    (tmp_path / "vehicles" / "multirotor.step-12.py311.nbi").touch()
    assert compile_ahead.is_compiled()
    monkeypatch.setattr(compile_ahead, "CAN_CACHE", False)  # each start compiles
    assert not compile_ahead.is_compiled()
