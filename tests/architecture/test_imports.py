"""The import contracts between packages, and the modules that a base install without the simulator must import."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_import_contracts_hold():
    linter = [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"]
    run = subprocess.run(linter, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout


def test_a_base_install_imports_agent_link_logger_and_judge_without_the_simulator():
    """numba, embreex and matplotlib belong to the extra [sim], which a Raspberry Pi does not need."""
    code = """
import importlib.abc, sys
class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in ('numba', 'embreex', 'matplotlib', 'trimesh'):
            raise ImportError(name)
sys.meta_path.insert(0, Refuse())
import dronecats.agent.loop, dronecats.agent.models.wire_formats, hil.link.link, hil.link.transport, hil.cameras.open
import dronecats.judge.episode, dronecats.flight.logger.recorder
import dronecats.flight.run.connected, dronecats.pilots.server, dronecats.pilots.vision.pilot
import dronecats.cli.fly, dronecats.cli.judge, dronecats.cli.doctor
"""
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
