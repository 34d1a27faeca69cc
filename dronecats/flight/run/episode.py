"""Flies one episode from take-off to landing, in the same way for every autopilot."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.agent.cockpit import Agent, AgentFactory, Cockpit, HostPace
from dronecats.agent.pictures import PicturePath
from dronecats.flight.run.ascent import StartOffset, ascend
from dronecats.flight.run.landing import drone_labels, finish, notify_safely, tending, unexpected
from dronecats.flight.run.pilot import OpenPilot
from dronecats.flight.run.progress import SafetyLog, StepLines
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import Authority
from dronecats.flight.stages.stage import Stage
from dronecats.judge.judged_flight import succeeded
from foundation.errors import BudgetError, DronecatsError, ModelRejectedError
from foundation.run_folder import layout
from foundation.run_folder.reading import read
from foundation.run_folder.rows import Decision
from foundation.run_folder.writing import LineLog, PromptLog
from foundation.setpoints import Hold
from hil.link.envelope import unwatched
from hil.link.link import Link, TakeoverError
from hil.preflight.failsafes import read_failsafe

if TYPE_CHECKING:
    from dronecats.flight.run.truth import TrueStart  # only for types, because it needs the simulator


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """The started parts that an episode needs."""

    stage: Stage
    starts: list[StartOffset]  # start pose of each drone
    pilot: OpenPilot
    true_start: "TrueStart | None" = None  # checks whether the episode may begin; None: no check
    pictures: PicturePath | None = None  # picture faults to inject; None: no faults


@dataclass(frozen=True, slots=True)
class EpisodeEnd:
    reason: str  # cap (time limit reached), decided, budget, rejected, interrupted, takeover, error
    error: DronecatsError | None
    sim_seconds: float
    wall_seconds: float
    steps: int


REASONS: dict[type[DronecatsError], str] = {
    TakeoverError: "takeover", BudgetError: "budget", ModelRejectedError: "rejected",
}  # fmt: skip


def fly(
    flight: Flight,
    ready: Ready,
    make_agent: AgentFactory,
    authority: Authority,
    folder: Path,
    notify: Callable[[str], None],
) -> EpisodeEnd:
    """Fly the drones of a stage (vehicles, camera and logger) to their start poses, let an agent fly, and land.

    Errors in flight are not raised: `EpisodeEnd` has them.
    """
    stage, true_start, cap_s = ready.stage, ready.true_start, flight.spec.seconds
    log, prompts = LineLog(folder / layout.DECISIONS), PromptLog(folder / layout.PROMPTS)
    agent: Agent | None = None
    reason, error = "cap", None  # type: str, DronecatsError | None
    began_s: float | None = None
    watch = VerdictWatch(folder, flight.spec.full)
    safety = SafetyLog(folder / layout.SAFETY, stage.links, notify)
    try:
        for link in stage.links:
            link.on_wait = tending(stage.links, link, stage.check)
        for label, link in zip(drone_labels(stage.links), stage.links, strict=True):
            link.on_silence = partial(_warn_of_silence, notify, label)
        if authority.dry or not authority.arm:
            take_over(stage.links, authority, notify)
        else:
            ascend(stage.links, ready.starts, notify, true_start.check_estimates if true_start else None)
        if true_start:
            true_start.check_starts(stage.links)
        for link in stage.links:
            link.settle_envelope()
            if link.limits and (warning := unwatched(link.state, link.limits)):
                notify(f"      envelope: {warning}")
        agent = make_agent(_begin(flight, ready, folder, log, prompts, notify))
        began_s = time.monotonic()  # for `wall_seconds`
        agent.fly(cap_s, watch.decided)
        reason = "decided" if watch.success else "cap"
    except KeyboardInterrupt:
        reason = "interrupted"
    except DronecatsError as fault:
        reason, error = REASONS.get(type(fault), "error"), fault
    except Exception as bug:
        reason, error = "error", unexpected(bug, folder)
    if error is not None:
        notify_safely(notify, f"the flight ends: {error}")  # printed before landing and closing, which take seconds
    episode_s = agent.now_s if agent else 0.0
    wall_s = time.monotonic() - began_s if began_s is not None else 0.0
    stage.mend()
    error = finish(stage, reason, error, authority.then, notify)
    safety.sum_up()
    log.close()
    prompts.close()
    ended = "error" if error and reason not in REASONS.values() else reason
    return EpisodeEnd(ended, error, episode_s, wall_s, agent.steps if agent else 0)


def _warn_of_silence(notify: Callable[[str], None], label: str, seconds: float) -> None:
    """Print the time without telemetry. decisions.jsonl has this time as `host_lag_s` of the pending decision."""
    notify_safely(notify, f"      {label}no telemetry for {seconds:.1f} s; the agent waited")


def take_over(links: Sequence[Link], authority: Authority, notify: Callable[[str], None]) -> None:
    """Connect to vehicles that a person flies. Unless it is a dry run, wait until the person hands them over."""
    for link in links:
        link.connect()
        if not authority.dry:
            link.failsafe = read_failsafe(link)
            notify(f"{link.firmware or 'the vehicle'}: waiting for a person to arm …")
            link.await_handover(notify)


def _begin(
    flight: Flight, ready: Ready, folder: Path, log: LineLog, prompts: PromptLog, notify: Callable[[str], None]
) -> Cockpit:
    """Begin the episode, and return the interface for its agent."""
    stage, pilot = ready.stage, ready.pilot
    for link in stage.links:
        if not link.streaming:  # after `ascend`, the vehicle already holds its start pose
            link.fly(Hold())
        link.start_offboard()
    t0_us = max(link.time_us for link in stage.links)
    stage.begin(t0_us, flight.spec.seconds)
    for link in stage.links:  # so that the first frame is taken after the start of the episode
        link.wait(0.1)
    for link in stage.links:  # from now on the agent ticks all links in turn
        link.on_wait = stage.check

    host = HostPace(time.monotonic, stage.speed) if stage.speed else None  # measures delays by this computer

    def on_tick() -> None:
        stage.check()
        pilot.check()
        if host:
            host.tick(max(link.time_us for link in stage.links) / 1e6)

    return Cockpit(
        aircraft=stage.links,
        camera=stage.camera,
        camera_model=stage.camera_model,
        log=log,
        prompts=prompts,
        frames_dir=folder / layout.FRAMES,
        commander_log=folder / layout.COMMANDER,
        executor=stage.executor,
        t0_us=t0_us,
        seed=flight.seed,
        on_step=StepLines(notify, len(ready.starts), pilot.spent, flight.spec.stop_unreadable),
        on_tick=on_tick,
        pictures=ready.pictures,
        host=host,
    )


class VerdictWatch:
    """Checks after each declaration (a drone says that it has arrived) whether the flight is a success.

    In real time the logger may measure a declaration late, so each decision repeats the check until there is a result.
    The watch reads the logger's files with the judge's own function. The agent learns only that the flight may end.
    """

    def __init__(self, folder: Path, full: bool) -> None:
        self._folder, self._full = folder, full
        self._unsettled = False
        self.success = False

    def decided(self, decision: Decision) -> bool:
        self._unsettled |= decision.declares
        if self._full or not self._unsettled:
            return False
        succeeds = succeeded(read(self._folder))
        self.success, self._unsettled = bool(succeeds), succeeds is None
        return self.success
