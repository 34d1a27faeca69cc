"""Ends every flight: orders the landing, informs the logger, and waits until the vehicles have landed."""

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

# a landing begins after the episode, so the logs already have all declarations that the verdict needs
AFTERWARDS = "The score is not affected: the episode had ended. The vehicle may still be armed."


def finish(
    stage: Stage, reason: str, error: DronecatsError | None, then: str, notify: Callable[[str], None]
) -> DronecatsError | None:
    """Order the landing, tell the logger, wait for the landing. Return the flight's error, None if there is none.

    The order to land comes first, so that a hanging logger, a closed terminal or a second Ctrl-C cannot prevent it. The
    returned error is the error of a process that is gone or hangs, else `error`, else the logger's.
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
    """Print a line; a closed terminal is not an error."""
    with contextlib.suppress(OSError, ValueError):
        notify(line)


@contextlib.contextmanager
def orders_first(notify: Callable[[str], None]) -> Iterator[list[int]]:
    """Yield a list that is empty until the first Ctrl-C. Within the context, only a second Ctrl-C interrupts."""
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
    """Handle Ctrl-C and similar signals until the context ends. Does nothing outside the main thread.

    An ignored SIGHUP stays ignored, as after `nohup`. An ignored SIGINT is handled all the same: a shell starts
    background commands with SIGINT ignored, but a flight that gets a SIGINT must land.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handled = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        handled.append(signal.SIGHUP)
    before = [(number, signal.signal(number, handler)) for number in handled]
    try:
        yield
    finally:
        for number, former in before:
            signal.signal(number, former)


ENDINGS = {"land": "landing …", "return": "returning …", "hold": "holding: you have control of the vehicle"}


def order_landing(stage: Stage, then: str, notify: Callable[[str], None]) -> list[Link]:
    """End the flight of every armed drone: stop, then land, return or hold (`then`). Return the drones that will land.

    A drone that does not answer does not delay the others. A drone that another pilot has taken over gets no order.
    """
    landing = []
    for label, link in zip(drone_labels(stage.links), stage.links, strict=True):
        # a dead logger, model or drone must not keep a vehicle in the air
        link.on_wait = tending(stage.links, link, stage.check_vehicles, (DronecatsError, OSError))
        try:
            if link.taken_by is not None or link.dry:
                link.stop_stream()
                say_failsafe(link, notify)
            elif link.may_fly():
                notify(ENDINGS[then])
                link.give_up(then)
                if then != "hold":
                    landing.append(link)
        except Exception as fault:  # continue: the next vehicle needs its order, and the verdict is not affected
            link.stop_stream()
            notify(f"{label}the command to {then} failed: {fault}. {AFTERWARDS}")
            say_failsafe(link, notify)
    return landing


def tending(
    links: Sequence[Link], waiting: Link, check: Callable[[], None], ignored: tuple[type[Exception], ...] = ()
) -> Callable[[], None]:
    """Return the function to call while one link waits: it calls `check`, and sends the other drones their setpoints.

    A drone leaves Offboard when its setpoints stop. `ignored`: errors of the other drones that do not end the wait.
    """
    fleet = [link for link in links if link is not waiting]

    def tend() -> None:
        check()
        for link in fleet:
            with contextlib.suppress(*ignored):
                link.keep_up()

    return tend


def say_failsafe(link: Link, notify: Callable[[str], None]) -> None:
    """Print the failsafe of a vehicle that stays in Offboard without setpoints."""
    if link.is_left_to_failsafe and link.failsafe:
        notify(f"no more setpoints are sent. A vehicle that is still in offboard mode now does: {link.failsafe}")


def await_landing(links: Sequence[Link], flying: Sequence[Link], notify: Callable[[str], None]) -> None:
    for label, link in zip(drone_labels(links), links, strict=True):
        if link not in flying:
            continue
        try:
            link.wait_for(lambda state: not state.armed, 60.0, "landing and disarming")
        except DronecatsError as fault:
            notify(f"{label}no end of the landing was reported: {fault}. {AFTERWARDS}")


def drone_labels(links: Sequence[Link]) -> list[str]:
    """Return the prefix of a line about each drone: the drone's name in a fleet, empty for a single drone."""
    return [f"{drone_label(drone)}: " if len(links) > 1 else "" for drone in range(len(links))]


def unexpected(bug: Exception, folder: Path) -> DronecatsError:
    """Return an unexpected exception as an infrastructure error, and write its traceback to `folder`."""
    if isinstance(bug, OSError):  # a full disk or closed terminal: not a bug, and a traceback cannot be written
        return InfrastructureError(f"the flight's files or its output cannot be written: {bug.strerror or bug}")
    log = folder / "traceback.log"
    with contextlib.suppress(OSError), log.open("a", encoding="utf-8", errors="backslashreplace") as file:
        traceback.print_exception(bug, file=file)
    return InfrastructureError(f"an unexpected {type(bug).__name__}, which is a bug in dronecats; see {log}")
