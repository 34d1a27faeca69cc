"""The engine for a Ray cluster: one actor per core.

Ray sends each flight to an actor, and the contents of the written files back. So the nodes need no shared disk. Each
node needs dronecats and, for a model, the model's key in the environment. Needs the extra `cluster`.
"""

import contextlib
import os
import socket
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any
from uuid import uuid4

import ray
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from dronecats.bench.engine import ANSWER_S, HANG_S, InFlight, Sortie, flown_result, hanging, lost_result, written_bytes
from dronecats.flight.run.accounts import LedgerKeeper
from dronecats.flight.run.identity import code_digest
from dronecats.flight.spec.flight_spec import ON_CLUSTER
from dronecats.flight.spec.spec_file import as_json
from foundation.errors import InfrastructureError, UsageError
from foundation.files import file_errors_as
from foundation.run_folder.results import Result

FLIGHTS_MAX = 64  # flights at a time per actor; each has a thread, which mostly waits for a model
LOOK = "look"  # Ray concurrency group with its own thread, so that checks do not wait for flights
GONE_S = 30.0  # wall s to wait until a killed actor is gone
LOOK_S = 30.0  # wall s between two checks of the workers while no flight ends
CONNECT_S = 10.0  # wall s, longest wait until the head of a cluster accepts a connection
STARTED_S = 300.0  # wall s, longest wait until an actor has started; a worker also compiles
GONE = (ray.exceptions.RayActorError, ray.exceptions.ObjectLostError, ray.exceptions.NodeDiedError,
        ray.exceptions.WorkerCrashedError)  # fmt: skip


class ClusterWorker:
    """The Ray actor. It flies in a temporary folder of its node and returns the files of this folder."""

    def __init__(self) -> None:
        self._folders: dict[str, Path] = {}  # folders of the flights in the air, by the key of the flight

    def ready(self) -> str:
        """Compile the kernels, and return the digest of the code that will fly."""
        from dronecats.bench.worker import compile_all

        compile_all()
        return code_digest()

    def fly(self, flight: dict[str, Any], name: str, key: str) -> tuple[dict[str, Any], dict[str, bytes]]:
        """Return the outcome of `worker.fly_flight`, and the episode's files by their paths within its folder.

        `name`: name of the episode's folder. `key`: identifies the flight in `written`.
        """
        from dronecats.bench.worker import fly_flight
        from foundation.run_folder.folder import prepare

        with tempfile.TemporaryDirectory(prefix="dronecats-") as scratch:
            folder = Path(scratch) / name
            prepare(folder)
            self._folders[key] = folder
            try:
                outcome = fly_flight(flight, folder)
            finally:
                del self._folders[key]
            paths = sorted(path for path in folder.rglob("*") if path.is_file())
            files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
        return outcome, files

    def written(self) -> dict[str, int]:
        """Return `engine.written_bytes` of each flight in the air, by the key of the flight."""
        return {key: written_bytes(folder) for key, folder in list(self._folders.items())}


@dataclass(slots=True)
class _Actor:
    """A worker, and the number of its flights in the air."""

    handle: Any
    load: int = 0


@dataclass(slots=True, kw_only=True)
class _Flying(InFlight):
    worker: _Actor
    key: str  # identifies the flight in `ClusterWorker.written`


class ClusterEngine:
    """Flies on a Ray cluster. A failed flight raises no exception; its result has the error."""

    def __init__(self, jobs: int, ledger: Path | None, address: str | None = None) -> None:
        """`jobs`: flights at a time. `ledger`: file on this machine for the models' costs; None: no model costs money.

        `address`: HOST:PORT of the cluster; None: a cluster of this machine only. Raises UsageError,
        InfrastructureError.
        """
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no usage statistics to Ray
        self._own = not ray.is_initialized()
        if self._own:
            if address is not None:
                _check_reachable(address)
            try:
                ray.init(address=address, log_to_driver=False, include_dashboard=False, logging_level="ERROR")
            except (ConnectionError, ValueError, RuntimeError) as error:
                raise UsageError(f"--address {address}: no Ray cluster answers there: {error}") from None
        self._keeper: Any = None
        self._ledger: str | None = None
        if ledger is not None:
            self._keeper, self._ledger = _keeper(ledger)
        self._workers: list[_Actor] = []
        self._flying: dict[Any, _Flying] = {}
        self._most = max(1, min(jobs, int(ray.cluster_resources().get("CPU", 1))))

    def begin(self, sortie: Sortie) -> None:
        """Hand the flight to the least busy worker, or to a new worker if the cluster has a core for it."""
        worker = min(self._workers, key=lambda w: w.load, default=None)
        if worker is None or (worker.load and len(self._workers) < self._most):
            worker = self._hire() or worker
        if worker is None:
            raise InfrastructureError("no worker can be started: the cluster has no free core. Wait, or add nodes")
        flight = sortie.flight
        if self._ledger is not None:
            flight = replace(flight, accounts=replace(flight.accounts, ledger=ON_CLUSTER + self._ledger, cache=None))
        key = uuid4().hex
        reference = worker.handle.fly.remote(as_json(flight), sortie.folder.name, key)
        worker.load += 1
        self._flying[reference] = _Flying(sortie, worker=worker, key=key)

    def landed(self) -> tuple[Sortie, Result]:
        """Wait until a flight ends, write its files to its folder, and return it with its result."""
        ready: list[Any] = []
        while not ready:
            ready, _ = ray.wait(list(self._flying), num_returns=1, timeout=LOOK_S)
            if not ready:
                self._look()
        reference = ready[0]
        flying = self._flying.pop(reference)
        flying.worker.load -= 1
        sortie = flying.sortie
        try:
            outcome, files = ray.get(reference)
        except GONE as death:
            if flying.worker in self._workers:
                self._workers.remove(flying.worker)
                ray.kill(flying.worker.handle)
            return sortie, lost_result(sortie, f"its worker ended: {type(death).__name__}")
        except ray.exceptions.RayError as fault:
            return sortie, lost_result(sortie, f"its worker failed: {type(fault).__name__}")
        _write_files(files, sortie.folder)
        return sortie, flown_result(outcome, sortie)

    def close(self) -> None:
        """Abort the flights in the air. A cluster that was already running continues to run."""
        actors = [worker.handle for worker in self._workers] + ([self._keeper] if self._keeper is not None else [])
        for actor in actors:
            ray.kill(actor)
        for actor in actors:  # a kill is a request, which is lost if this process ends too early, so wait
            with contextlib.suppress(ray.exceptions.RayError):
                ray.get(actor.__ray_ready__.remote(), timeout=GONE_S)
        self._workers, self._flying = [], {}
        if self._own:
            ray.shutdown()

    def _look(self) -> None:
        """Kill the workers that do not answer or have a flight that hangs. Their flights then end with an error."""
        for worker in self._workers:
            try:
                written = ray.get(worker.handle.written.options(concurrency_group=LOOK).remote(), timeout=ANSWER_S)
            except ray.exceptions.RayError:  # gone, or no answer within ANSWER_S
                ray.kill(worker.handle)
                continue
            flights = [flying for flying in self._flying.values() if flying.worker is worker]
            for flying in flights:
                flying.check(written.get(flying.key, 0))
            if hanging(flights, HANG_S) is not None:
                ray.kill(worker.handle)

    def _hire(self) -> _Actor | None:
        """Start a worker and return it; None: the cluster has no core for it. Raises DronecatsError."""
        options = {"num_cpus": 1, "max_concurrency": FLIGHTS_MAX, "scheduling_strategy": "SPREAD"}
        # Ray may place a worker on a lost node until it notices the loss, so try once per node
        nodes = len(ray.nodes())
        for attempt in range(1, nodes + 1):
            handle = ray.remote(concurrency_groups={LOOK: 1})(ClusterWorker).options(**options).remote()
            try:
                ready = handle.ready.remote()
                if not self._starts(ready):
                    ray.kill(handle)
                    self._most = max(1, len(self._workers))
                    return None
                digest = ray.get(ready)
                break
            except ray.exceptions.RayError as fault:
                ray.kill(handle)
                if attempt == nodes or not isinstance(fault, GONE):
                    raise InfrastructureError(
                        f"no worker of the cluster can be started: {_first_line(fault)}"
                    ) from None
        if digest != code_digest():
            ray.kill(handle)
            raise UsageError(
                "a node of the cluster has another version of dronecats. Install the same version on all nodes"
            )
        self._workers.append(_Actor(handle))
        return self._workers[-1]

    def _starts(self, ready: Any) -> bool:
        """Wait until a worker has started; return False if the cluster has no core for it, as after a node's loss.

        Raises RayError when the worker has not started within `STARTED_S`.
        """
        ends_s = time.monotonic() + STARTED_S
        while not ray.wait([ready], timeout=LOOK_S)[0]:
            cores = sum(node["Resources"].get("CPU", 0.0) for node in ray.nodes() if node["Alive"])
            if int(cores) <= len(self._workers):
                return False
            if time.monotonic() > ends_s:
                raise ray.exceptions.GetTimeoutError(f"a worker of the cluster has not started within {STARTED_S:g} s")
        return True


def _check_reachable(address: str) -> None:
    """Raise UsageError when nothing listens at HOST:PORT. Ray itself would wait for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not port.isdigit():
        raise UsageError(f"--address must be HOST:PORT of the cluster's head node, got '{address}'")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT_S).close()
    except OSError as error:
        raise UsageError(f"--address {address}: no Ray cluster answers there: {error}") from None


def _keeper(ledger: Path) -> tuple[Any, str]:
    """Start an actor that keeps a ledger on this node; return the actor and its name."""
    name = f"dronecats-ledger-{uuid4().hex}"
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    keeper = ray.remote(LedgerKeeper).options(name=name, num_cpus=0, scheduling_strategy=here).remote(ledger)
    try:
        ray.get(keeper.ready.remote(), timeout=STARTED_S)
    except ray.exceptions.RayError as fault:
        raise InfrastructureError(f"the ledger {ledger} cannot be written: {_first_line(fault)}") from None
    return keeper, name


def _write_files(files: Mapping[str, bytes], folder: Path) -> None:
    """Write the files of an episode, by their paths in its folder. Raises InfrastructureError."""
    with file_errors_as(InfrastructureError, f"{folder} cannot be written"):
        for name, data in files.items():
            inside = PurePosixPath(name)
            if inside.is_absolute() or ".." in inside.parts:
                raise InfrastructureError(f"a worker of the cluster returned {name}, outside the episode's folder")
            path = folder / inside
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)


def _first_line(fault: Exception) -> str:
    return str(fault).strip().splitlines()[0] if str(fault).strip() else type(fault).__name__
