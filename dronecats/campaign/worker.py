"""A worker: a process that flies one episode after the other in lockstep, and dies with whoever started it."""

import os
import threading
from pathlib import Path
from typing import Any

from dronecats.agent.prompt import Prompt
from dronecats.run.plan import resolve
from dronecats.run.simulated import configuration, fly_plan


class Worker:
    """Part of a run (`dronecats.processes.child`). Its one command flies an episode and answers with the result."""

    def __init__(self, config: dict[str, Any]) -> None:
        self._flight = dict(config["flight"])
        prompt_file = self._flight.pop("prompt_file", None)
        self._prompt_file = Path(prompt_file) if prompt_file else None
        self._prompt = Prompt.load(self._prompt_file)
        self._idle = threading.Event()
        compile_all()

    def ready(self) -> dict[str, Any]:
        return {"pid": os.getpid()}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Fly `episode` in `folder`."""
        plan = resolve(**self._flight, episode=arguments["episode"], prompt_file=self._prompt_file)
        result = fly_plan(
            plan,
            self._prompt,
            Path(arguments["folder"]),
            lambda line: None,
            configuration(plan, self._prompt),
        )
        return {key: value for key, value in result.items() if key not in ("status", "run_dir")}

    def turn(self) -> None:
        """Wait a little; `dronecats.processes.child` looks for the next command."""
        self._idle.wait(0.01)

    def orphaned(self) -> None:
        """Whoever wanted the result is gone: nobody waits for a flight of minutes to end."""
        os._exit(1)

    def close(self) -> None:
        pass


def compile_all() -> None:
    """Have every kernel of flight compiled, so that workers that start later find them in the cache."""
    from dronecats.sitl.simulation import Place, SimulatedVehicle
    from vehicles import airframe

    vehicle = SimulatedVehicle(0, airframe.load("x500"), Place((0.0, 0.0, 0.0), 0.0), seed=0, origin=(0.0, 0.0, 0.0))
    vehicle.advance()
    vehicle.close()


def create(config: dict[str, Any]) -> Worker:
    """Return a worker: key flight, the arguments of `dronecats.run.plan.resolve` but for the episode."""
    return Worker(config)
