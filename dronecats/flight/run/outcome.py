"""The end of every flight: whatever came of it, a judged folder and one JSON object."""

import signal
import statistics
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from dronecats.flight.run.episode import Flown
from dronecats.flight.run.identity import write_identity
from dronecats.flight.run.landing import unexpected
from dronecats.judge.episode import verdict_of, write_verdict
from foundation.errors import BudgetError, DronecatsError, InfrastructureError, UsageError
from foundation.extras import missing_package
from foundation.run_folder.layout import DECISIONS
from foundation.run_folder.reading import rows
from foundation.run_folder.results import Result
from foundation.run_folder.rows import Decision

Say = Callable[[str], None]
Written = TypeVar("Written")


def fly_and_judge(
    flight: Callable[[], Flown],
    folder: Path,
    episode: str,
    pilot_name: str,
    afterwards: Callable[[Flown], None] = lambda flown: None,
    pace: Callable[[], Mapping[str, float] | None] = lambda: None,
) -> dict[str, Any]:
    """Fly, and whatever comes of it leave a judged folder; return the JSON object of `fly`.

    `afterwards` writes what else belongs to the flight; like the verdict, it is not disturbed by a Ctrl-C. `pace` is
    asked after the flight how well it held real time.
    """
    try:
        flown = flight()
    except KeyboardInterrupt:
        flown = Flown("interrupted", None, 0.0, 0.0, 0)
    except BudgetError as spent:
        flown = Flown("budget", spent, 0.0, 0.0, 0)
    except DronecatsError as error:
        flown = Flown("error", error, 0.0, 0.0, 0)
    except ImportError as missing:
        sentence = missing_package(missing)
        flown = Flown("error", UsageError(sentence) if sentence else unexpected(missing, folder), 0.0, 0.0, 0)
    except Exception as bug:
        flown = Flown("error", unexpected(bug, folder), 0.0, 0.0, 0)
    with undisturbed():
        _, unidentified = _kept(lambda: write_identity(folder, pace()), folder)  # a verdict says that all else is there
        verdict, unkept = _kept(lambda: write_verdict(folder), folder)
        _, unwritten = _kept(lambda: afterwards(flown), folder)
    verdict = verdict or verdict_of(folder)
    if fault := flown.error or unkept or unidentified or unwritten:
        flown = replace(flown, error=fault)
    status = {"cap": 0, "decided": 0, "interrupted": 130}.get(flown.reason, 3)
    if flown.error:
        status = flown.error.exit_status
    elif status == 0 and verdict.outcome == "error":
        status = 3
    result = Result(
        episode=episode,
        pilot=pilot_name,
        outcome=verdict.outcome,
        success=verdict.success,
        ne_m=verdict.ne_m,
        steps=flown.steps,
        declarations=verdict.declarations,
        success_at_first=verdict.success_at_first,
        success_within_three=verdict.success_within_three,
        declaration_precision=verdict.declaration_precision,
        false_declarations=verdict.false_declarations,
        censored=verdict.censored,
        sim_seconds=round(flown.sim_seconds, 3),
        wall_seconds=round(flown.wall_seconds, 3),
        real_time_factor=round(flown.sim_seconds / flown.wall_seconds, 3) if flown.wall_seconds else 0.0,
        run_dir=str(folder),
        error=str(flown.error) if flown.error else verdict.error if flown.reason != "interrupted" else None,
        reason=flown.reason,
        status=status,
        host_stalls=verdict.host_stalls,
    )
    return result.as_json()


def _kept(write: Callable[[], Written], folder: Path) -> tuple[Written | None, DronecatsError | None]:
    """Write something of a flight that is over; a disk that refuses it is told, and costs nothing else."""
    try:
        return write(), None
    except InfrastructureError as fault:
        return None, fault
    except OSError as fault:
        return None, unexpected(fault, folder)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore Ctrl-C and its like for the moment of writing the verdict; they reach the main thread alone."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, signal.SIG_IGN) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def served_rate_hz(folder: Path) -> float | None:
    """Return the decisions per second of vehicle time that the pilot was really served with, the median."""
    rates = [d.rate_hz for d in rows(folder / DECISIONS, Decision) if d.rate_hz]
    return statistics.median(rates) if rates else None
