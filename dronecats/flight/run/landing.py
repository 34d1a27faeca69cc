"""The end of every flight: the vehicles get the order to land before anything else is done."""

import contextlib
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from types import FrameType

from dronecats.flight.stages.stage import Stage
from foundation.errors import DronecatsError, InfrastructureError
from foundation.run_folder.rows import drone_label
from hil.link.link import Link

# a landing begins when the episode is over: all declarations that the verdict is made of are in the logs by then
AFTERWARDS = "The score is not affected: the episode had ended. The vehicle may still be armed."


def finish(
    stage: Stage, reason: str, error: DronecatsError | None, then: str, notify: Callable[[str], None]
) -> DronecatsError | None:
    """Order the landing, tell the logger, wait for the landing. Return the flight's error, None if there is none.

    In this order: a logger that hangs, a terminal that is closed or a second Ctrl-C must not keep a vehicle from being
    told to land. The error is that of a process that is gone or hangs, if there is one, else `error`, else the
    logger's.
    """
    say_safely = partial(notify_safely, notify)
    try:
        with orders_first(say_safely) as hurried:
            flying = order_landing(stage, then, say_safely)
        if error and reason == "error":
            error = stage.cause(error)
        try:
            stage.end(reason, str(error) if error else None)
        except DronecatsError as broken:
            error = error or broken
        except OSError as broken:
            error = error or InfrastructureError(f"the logger did not get the end of the flight: {broken}")
        if hurried:
            raise KeyboardInterrupt
        await_landing(stage.links, flying, say_safely)
    except KeyboardInterrupt:
        say_safely("stopped by a second interrupt, without waiting")
    return error


def notify_safely(notify: Callable[[str], None], line: str) -> None:
    """Print a line; a terminal that is gone is no error."""
    with contextlib.suppress(OSError, ValueError):
        notify(line)


@contextlib.contextmanager
def orders_first(notify: Callable[[str], None]) -> Iterator[list[int]]:
    """Keep a Ctrl-C that comes while a landing is being ordered (seconds) in the list; a second one leaves at once."""
    hurried: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        if hurried:
            raise KeyboardInterrupt
        hurried.append(number)
        notify("landing first. A second Ctrl-C leaves the vehicle as it is")

    with signals_handled(note):
        yield hurried


@contextlib.contextmanager
def signals_handled(handler: Callable[[int, FrameType | None], None] | signal.Handlers) -> Iterator[None]:
    """Handle Ctrl-C and its like until the context ends. They reach the main thread alone."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [(number, signal.signal(number, handler)) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    try:
        yield
    finally:
        for number, former in before:
            signal.signal(number, former)


def order_landing(stage: Stage, then: str = "land", notify: Callable[[str], None] = lambda line: None) -> list[Link]:
    """End the flight of every armed drone: stand still, hold, and then land or return.

    Returns those that will come down. One that does not answer stops no other, and one that somebody else has taken
    is left to them.
    """
    landing = []
    for label, link in zip(_labels(stage.links), stage.links, strict=True):
        # a dead logger or model must not keep the vehicle in the air, nor a drone that has gone keep another there
        link.on_wait = tending(stage.links, link, stage.check_vehicles, (DronecatsError, OSError))
        try:
            if link.taken_by is not None or link.dry:
                link.stop_stream()
                say_failsafe(link, notify)
            elif link.may_fly():
                notify(
                    {"land": "landing …", "return": "returning …", "hold": "holding: you have control of the vehicle"}[
                        then
                    ]
                )
                link.give_up(then)
                if then != "hold":
                    landing.append(link)
        except Exception as fault:  # after the episode, so it changes no verdict; and the next vehicle is told too
            link.stop_stream()
            notify(f"{label}the command to {then} failed: {fault}. {AFTERWARDS}")
            say_failsafe(link, notify)
    return landing


def tending(
    links: Sequence[Link], waiting: Link, check: Callable[[], None], ignored: tuple[type[Exception], ...] = ()
) -> Callable[[], None]:
    """Return what is done while one link waits: call `check`, and send the other drones their setpoints.

    A drone falls out of offboard when its setpoints stop. `ignored`: errors of the others that must not end the wait.
    """
    fleet = [link for link in links if link is not waiting]

    def tend() -> None:
        check()
        for link in fleet:
            with contextlib.suppress(*ignored):
                link.keep_up()

    return tend


def say_failsafe(link: Link, notify: Callable[[str], None]) -> None:
    """Print the failsafe of a vehicle that is left in offboard without setpoints."""
    if link.is_left_to_failsafe and link.failsafe:
        notify(f"no more setpoints are sent. A vehicle that is still in offboard mode now does: {link.failsafe}")


def await_landing(
    links: Sequence[Link], flying: Sequence[Link], notify: Callable[[str], None] = lambda line: None
) -> None:
    """Wait until every one of the drones that are `flying` has disarmed."""
    for label, link in zip(_labels(links), links, strict=True):
        if link not in flying:
            continue
        try:
            link.wait_for(lambda state: not state.armed, 60.0, "landing and disarming")
        except DronecatsError as fault:
            notify(f"{label}no end of the landing was reported: {fault}. {AFTERWARDS}")


def _labels(links: Sequence[Link]) -> list[str]:
    """Return the prefix of a line about each drone: its name in a fleet, empty for a single one."""
    return [f"{drone_label(drone)}: " if len(links) > 1 else "" for drone in range(len(links))]


def unexpected(bug: Exception, folder: Path) -> DronecatsError:
    """Return a mistake of ours as an infrastructure error; the traceback goes into the run folder."""
    if isinstance(bug, OSError):  # a full disk, a closed terminal: nobody's mistake, and a traceback has no place to go
        return InfrastructureError(f"the flight's files or its output cannot be written: {bug.strerror or bug}")
    log = folder / "traceback.log"
    with contextlib.suppress(OSError), log.open("a", encoding="utf-8", errors="backslashreplace") as file:
        traceback.print_exception(bug, file=file)
    return InfrastructureError(f"an unexpected {type(bug).__name__}, which is a bug in dronecats; see {log}")
