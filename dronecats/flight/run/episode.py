"""Flies one episode from take-off to landing, in the same way for every autopilot."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.agent.cockpit import Agent, AgentFactory, Cockpit, HostPace
from dronecats.agent.pictures import PicturePath
from dronecats.flight.run.ascent import StartOffset, ascend, unchecked
from dronecats.flight.run.landing import finish, notify_safely, tending, unexpected
from dronecats.flight.run.progress import SafetyLog
from dronecats.flight.spec.flight_spec import Authority
from dronecats.flight.stages.stage import Stage
from dronecats.judge.judged_flight import succeeded
from foundation.errors import BudgetError, DronecatsError, ModelRejectedError
from foundation.protocol import CAP_S
from foundation.run_folder import layout
from foundation.run_folder.reading import read
from foundation.run_folder.rows import Decision, drone_label
from foundation.run_folder.writing import LineLog, PromptLog
from foundation.setpoints import Hold
from hil.link.envelope import unwatched
from hil.link.link import Link, TakeoverError
from hil.preflight.failsafes import read_failsafe

if TYPE_CHECKING:
    from dronecats.flight.run.truth import TrueStart  # only for types, because it needs the simulator

EVERYTHING = Authority()  # the default permissions: arm, move the vehicle, and land it


@dataclass(frozen=True, slots=True)
class EpisodeEnd:
    reason: str  # cap (time limit reached), decided, budget, rejected, interrupted, takeover, error
    error: DronecatsError | None
    sim_seconds: float
    wall_seconds: float
    steps: int


def fly(
    stage: Stage,
    starts: list[StartOffset],
    make_agent: AgentFactory,
    folder: Path,
    *,
    seed: tuple[int, ...] = (0,),
    full: bool = False,
    cap_s: float = CAP_S,
    authority: Authority = EVERYTHING,
    pictures: PicturePath | None = None,
    check: Callable[[], None] = lambda: None,
    on_step: Callable[[Decision], None] = lambda decision: None,
    notify: Callable[[str], None] = lambda line: None,
    true_start: "TrueStart | None" = None,
) -> EpisodeEnd:
    """Fly the drones of a stage (vehicles, camera and logger) to their start poses, let an agent fly, and land.

    With `full`, the flight lasts until `cap_s` even after a success. `pictures` injects picture faults. The checks of
    `true_start` raise if the episode may not begin. `check` is called at every tick, besides the stage's own check. It
    raises if a part that the agent needs is gone. Errors in flight are not raised: `EpisodeEnd` has them.
    """
    log, prompts = LineLog(folder / layout.DECISIONS), PromptLog(folder / layout.PROMPTS)
    agent: Agent | None = None
    reason, error = "cap", None  # type: str, DronecatsError | None
    began_s: float | None = None
    watch = VerdictWatch(folder, full)
    safety = SafetyLog(folder / layout.SAFETY, stage.links, notify)
    try:
        for link in stage.links:
            link.on_wait = tending(stage.links, link, stage.check)
        for drone, link in enumerate(stage.links):
            label = f"{drone_label(drone)}: " if len(stage.links) > 1 else ""
            link.on_silence = partial(_warn_of_silence, notify, label)
        if authority.dry or not authority.arm:
            take_over(stage.links, authority, notify)
        else:
            ascend(stage.links, starts, notify, true_start.check_estimates if true_start else unchecked)
        if true_start:
            true_start.check_starts(stage.links)
        for link in stage.links:
            link.settle_envelope()
            if link.limits and (warning := unwatched(link.state, link.limits)):
                notify(f"      envelope: {warning}")
        agent = _begin(stage, make_agent, folder, log, prompts, on_step, check, cap_s, seed, pictures)
        began_s = time.monotonic()  # for `wall_seconds`
        agent.fly(cap_s, watch.decided)
        reason = "decided" if watch.success else "cap"
    except KeyboardInterrupt:
        reason = "interrupted"
    except TakeoverError as taken:
        reason, error = "takeover", taken
    except BudgetError as spent:
        reason, error = "budget", spent
    except ModelRejectedError as rejected:
        reason, error = "rejected", rejected
    except DronecatsError as fault:
        reason, error = "error", fault
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
    ended = "error" if error and reason not in ("takeover", "budget", "rejected") else reason
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
    stage: Stage,
    make_agent: AgentFactory,
    folder: Path,
    log: LineLog,
    prompts: PromptLog,
    on_step: Callable[[Decision], None],
    check: Callable[[], None],
    cap_s: float,
    seed: tuple[int, ...],
    pictures: PicturePath | None,
) -> Agent:
    for link in stage.links:
        if not link.streaming:  # after `ascend`, the vehicle already holds its start pose
            link.fly(Hold())
        link.start_offboard()
    t0_us = max(link.time_us for link in stage.links)
    stage.begin(t0_us, cap_s)
    for link in stage.links:  # so that the first frame is taken after the start of the episode
        link.wait(0.1)
    for link in stage.links:  # from now on the agent ticks all links in turn
        link.on_wait = stage.check

    host = HostPace(time.monotonic, stage.speed) if stage.speed else None  # measures delays by this computer

    def on_tick() -> None:
        stage.check()
        check()
        if host:
            host.tick(max(link.time_us for link in stage.links) / 1e6)

    return make_agent(
        Cockpit(
            aircraft=stage.links,
            camera=stage.camera,
            camera_model=stage.camera_model,
            log=log,
            prompts=prompts,
            frames_dir=folder / layout.FRAMES,
            commander_log=folder / layout.COMMANDER,
            executor=stage.executor,
            t0_us=t0_us,
            seed=seed,
            on_step=on_step,
            on_tick=on_tick,
            pictures=pictures,
            host=host,
        )
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
