"""Everything that decides what is flown, by whom and on what, as one value: it pickles, and it is JSON.

The rules between options are here and nowhere else: the command line, files and studies make a flight, and a flight
that contradicts itself raises UsageError.

A spec names nothing that only one machine has, except a script that is played, a map of one's own and the files of the
accounts. It holds what a file says, as the latencies of a `trace:FILE`, and not the file's name: so it is all that a
worker needs, wherever that is.
"""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from msgspec import UNSET

from dronecats.agent.latency import TRACE, TRACE_MAX, LatencyPolicy, split_policy, trace_name
from dronecats.agent.models.ledger import cost_limit, token_limit
from dronecats.agent.models.replay import FlightRecording
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.names import PAPER, STEADY
from dronecats.agent.reply.reading import ReplyParser
from dronecats.flight.spec.disturbances import UNDISTURBED, Disturbances
from foundation.declaration import ABOVE_0, Declaration, DeclaredNumber, check_bounds, declared, number
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder import layout
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision
from hil.cameras.lens import Calibration
from hil.link.envelope import SIMULATED, Limits

SCRIPTED = "scripted:divide"  # the default commander of built-in pilots
ON_CLUSTER = "ray:"  # before the name of a ledger that an actor of a cluster keeps
LATENCY = "fixed:0.5"  # two replies a second, the paper's smallest model served alone; see docs/latency.md
DEFAULT_LATENCY = LatencyPolicy.parse(LATENCY)
SEED_MAX = 2**31 - 1
COUNT_MAX = 10**9
SPEED = DeclaredNumber(name="--speed", low=0.01, high=100.0, unit="× real time, or max", help="factor on real time")


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulated:
    """A vehicle of our own simulation, with its camera."""

    airframe: str = "x500"
    autopilot: Literal["ours", "px4"] = "ours"
    px4: str | None = None  # the command that starts a PX4; None: it is waited for
    speed: float | None = declared(1.0, Declaration(quantity=SPEED))  # × real time; None: lockstep
    rendered: bool = True  # False: grey frames, for a pilot that does not look at them
    optics: dict[str, Any] | None = None  # lens, sensor and weather (docs/cameras.md); None: as in the benchmark

    def __post_init__(self) -> None:
        """Raise UsageError for what cannot be simulated."""
        check_bounds(self)
        if self.px4 and self.autopilot != "px4":
            raise UsageError("--px4 goes with --autopilot px4. Add it, or leave --px4 out")


@dataclass(frozen=True, slots=True, kw_only=True)
class Authority:
    """The permissions on a vehicle besides flying it. On our own simulated vehicles: all."""

    arm: bool = True  # False: a person arms, takes off and hands over
    then: Literal["land", "return", "hold"] = "land"  # what follows the hold at the end
    dry: bool = False  # decide, but move nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Connected:
    """A vehicle that we did not start: a real one, or one that simulates itself and sends its true poses."""

    url: str  # of its MAVLink
    camera: str | None = None  # address of its camera; None: our world, drawn where `truth` says that the vehicle is
    calibration: Calibration | None = None
    truth: str | None = None  # URL of its true poses
    sign: str | None = None  # file of the key with which its messages are signed; None: they are not
    authority: Authority = Authority(arm=False, then="hold")


@dataclass(frozen=True, slots=True, kw_only=True)
class Accounts:
    """The limits of a model's cost, and the files of this machine on which its questions are booked."""

    cost_limit_usd: float | None = None  # $, of all that the ledger holds; None: no limit
    token_limit: int | None = None  # of questions and replies, likewise
    ledger: str | None = None  # file, or ON_CLUSTER and a name; None: a file in the run folder
    cache: str | None = None  # file of replies; None: every question is sent

    def __post_init__(self) -> None:
        """Raise UsageError for limits that are none."""
        if self.cost_limit_usd is not None:
            cost_limit(self.cost_limit_usd)
        if self.token_limit is not None:
            token_limit(self.token_limit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outside:
    """Replies come from outside: another harness asks its own model (`dronecats.bench.harnesses`)."""

    harness: str  # gymnasium, inspect or inspect-robots
    name: str  # as the harness calls who answers
    axis_order: Literal["xy", "yx"] = "xy"  # in which the prompt asks for points
    lifted: str | None = (
        None  # the reasoning that the harness asks for after a `think`; None: as for any other question
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSpec:
    """One flight; or, without an episode, each flight of a run. Raises UsageError for what contradicts itself."""

    episode: str | None = None  # id of one that ships
    record: dict[str, Any] | None = None  # or one's own, as its file holds it
    map: str | None = None  # or a map alone, to do what `instruction` says
    instruction: str | None = None  # where no episode brings one
    simulated: Simulated | None = None  # one of these two
    connected: Connected | None = None
    drones: int | None = None  # of a simulated episode; None: as many as its record has starts
    pilot: str | None = None  # a built-in pilot, no model; or
    model: ModelSpec | None = None
    outside: Outside | None = None
    replay: FlightRecording | None = None  # in the place of whichever of the two flew it
    accounts: Accounts = Accounts()
    command: Literal["flat", "hierarchical", "solo"] = "flat"  # one context for all; a commander; or each on its own
    commander: ModelSpec | None = None  # of a hierarchy; None: the same model, …
    scripted: str | None = None  # … or a built-in commander, no model; None of a built-in pilot: the one that divides
    prompt: str | None = None  # a template; None: the one that ships
    agent: str = PAPER  # who flies: another of `dronecats.flight.run.pilot`, or MODULE:NAME of one of one's own
    latency: LatencyPolicy = DEFAULT_LATENCY
    parser: ReplyParser = "strict"  # how replies are read: docs/replies.md
    stop_unreadable: int | None = number(  # replies in a row that are no actions and end the flight; None: none do
        None, "--stop-unreadable", "replies in a row that are no actions", low=1, high=COUNT_MAX, whole=True
    )
    patience_s: float | None = number(  # s without a frame or a reply after which the flight ends; None: theirs
        None, "--patience", "time without a frame or a reply", low=1.0, high=CAP_S, unit="s"
    )
    disturbances: Disturbances = UNDISTURBED  # of pictures, wire and vehicle, on purpose
    seed: int = number(0, "--seed", "tells flights of one episode apart", high=SEED_MAX, whole=True)
    seconds: float = number(CAP_S, "--seconds", "vehicle time, the flight's length", low=ABOVE_0, high=CAP_S, unit="s")
    full: bool = False  # fly to its end although the verdict is decided
    envelope: Limits | None = SIMULATED  # None: no limits at all
    keep_ulog: bool = False  # keep the log that a PX4 writes on board in the episode's folder

    def __post_init__(self) -> None:
        """Raise UsageError for numbers out of bounds, and for what does not go together."""
        check_bounds(self)
        _check_one("a vehicle, simulated or connected: --sitl, or --connect URL", self.simulated, self.connected)
        pilots = "a pilot, model or outside: --pilot NAME, or --model PROVIDER/NAME"
        _check_one(pilots, self.pilot, self.model, self.outside)
        if sum(place is not None for place in (self.episode, self.record, self.map)) > 1:
            raise UsageError("a flight needs exactly one of episode, record and map. Leave the others out")
        self._check_commander()
        if self.connected:
            self._check_connected(self.connected)
        if self.simulated:
            self._check_simulated(self.simulated)

    def _check_commander(self) -> None:
        if self.commander and self.scripted:
            raise UsageError("a flight has two commanders: commander and scripted. Leave one of them out")
        if (self.commander or self.scripted) and self.command != "hierarchical":
            raise UsageError("--commander goes with --command hierarchical. Add it, or leave --commander out")
        if self.command == "hierarchical" and self.agent == STEADY:
            raise UsageError(
                f"--agent {STEADY} goes with --command flat or solo. Under a commander, use the agent paper"
            )

    def _check_connected(self, connected: Connected) -> None:
        if self.command != "flat":
            raise UsageError(
                f"--command {self.command} goes with --sitl, because a connected vehicle is one drone. Leave it out"
            )
        if self.drones is not None:
            raise UsageError("--drones goes with --sitl, because a connected vehicle is one drone. Leave it out")
        if self.envelope is None:
            raise UsageError("a vehicle that is not simulated needs an envelope. To change its limits: --envelope FILE")
        if self.disturbances != UNDISTURBED:
            raise UsageError("disturbances go with --sitl. Leave them out")
        has_world = any(place is not None for place in (self.episode, self.record, self.map))
        if has_world != (connected.truth is not None):
            raise UsageError(
                "--world needs --truth, because the world is drawn from the true pose. Give both, or neither"
            )
        if has_world and (connected.camera or connected.calibration):
            raise UsageError(
                "--camera does not go with --world, which draws the pictures itself. Leave one of them out"
            )
        if not has_world and not (connected.camera and self.instruction):
            raise UsageError("--connect needs --camera URL and --instruction TEXT, or --world EPISODE and --truth URL")
        if connected.authority.arm and connected.authority.dry:
            raise UsageError("--dry-run moves nothing. Leave --arm out")

    def _check_simulated(self, simulated: Simulated) -> None:
        lockstep = simulated.speed is None
        self.disturbances.check_clock(lockstep=lockstep)
        if lockstep and self.latency.real:
            raise UsageError(
                "--latency real does not go with --speed max, where the vehicle's clock waits for replies."
                " Use fixed:SECONDS"
            )
        if self.keep_ulog and not (simulated.autopilot == "px4" and simulated.px4):
            raise UsageError(
                "--keep-ulog goes with --connect, or with --autopilot px4 and --px4 COMMAND. Add them, or leave it out"
            )

    @property
    def scripted_commander(self) -> str | None:
        """The built-in commander of a hierarchy, None without one or with a model."""
        if self.command != "hierarchical" or self.commander or (self.model and not self.scripted):
            return None
        return self.scripted or SCRIPTED

    @property
    def pilot_name(self) -> str:
        """The built-in pilot's name, PROVIDER/NAME of a model or HARNESS:NAME; of a replay, that of who flew it."""
        name = self.pilot or (self.model.title if self.model else "")
        name = f"{self.outside.harness}:{self.outside.name}" if self.outside else name
        return f"replay of {name}" if self.replay else name


def _check_one(wanted: str, *values: object) -> None:
    if sum(value is not None for value in values) != 1:
        raise UsageError(f"a flight needs {wanted}. Choose one")


COLUMN = "latency_s"  # of a CSV file
BYTES_MAX = 4_000_000
AT = "@"  # between a file's name and what its latencies are known by


def latency_policy(text: str, recorded: Sequence[float] | None = None) -> LatencyPolicy:
    """Return the policy of a text; the file of a `trace:FILE` is read.

    `recorded`: latencies (s) that are there already, for a text that `carried` gave of them: no file is read then.
    Raises UsageError for a policy that is none, and for a file that holds no latencies.
    """
    file = _file(text)
    if file is None:
        return LatencyPolicy.parse(text)
    trace = recorded if recorded is not None and trace_name(recorded) == digest_of(text) else read_trace(Path(file))
    return LatencyPolicy.parse(_instead(text, trace_name(trace)), trace)


def carried(text: str) -> str:
    """Return the words of a policy as they hold on every machine: of `trace:FILE`, `trace:NAME@DIGEST`.

    NAME is the file's without its folder, for people, DIGEST what `trace_name` gives. Raises UsageError as
    `read_trace` does.
    """
    file = _file(text)
    return (
        text if file is None else _instead(text, f"{Path(file).resolve().name}{AT}{trace_name(read_trace(Path(file)))}")
    )


def from_folder(text: str, folder: Path) -> str:
    """Return the words of a policy with the FILE of its `trace:FILE`, unless it is absolute, in a folder."""
    file = _file(text)
    return text if file is None else _instead(text, str(folder / file))


def digest_of(text: str) -> str | None:
    """Return by which name the recorded latencies of words that `carried` gave are known; None: they have none."""
    file = _file(text)
    return file.rpartition(AT)[2] if file and AT in file else None


def _file(text: str) -> str | None:
    return next((part.partition(":")[2] for part in split_policy(text) if part.startswith(f"{TRACE}:")), None)


def _instead(text: str, name: str) -> str:
    words = split_policy(text)
    return "+".join(f"{TRACE}:{name}" if part == f"{TRACE}:{_file(text)}" else part for part in words)


def read_trace(path: Path) -> tuple[float, ...]:
    """Return the latencies (s) of a run or episode folder in the order of its steps, or of a CSV file.

    Of a CSV that is the column `latency_s`, or its only one. Raises UsageError.
    """
    if path.exists() and not (path.is_dir() or path.is_file()):
        raise UsageError(f"--latency trace:{path} is not a file. Name a run folder or a CSV file")
    try:
        latencies = _of_run(path) if path.is_dir() else _of_csv(path)
    except OSError as error:
        raise UsageError(f"--latency trace:{path} cannot be read: {error.strerror}") from None
    if not latencies:
        raise UsageError(f"--latency trace:{path} has no latency. Name a run with decisions, or a CSV file")
    if len(latencies) > TRACE_MAX:
        raise UsageError(
            f"--latency trace:{path} has {len(latencies):,} latencies, more than {TRACE_MAX:,}. Shorten it"
        )
    return tuple(round(seconds, 6) for seconds in latencies)


def _of_run(folder: Path) -> list[float]:
    own = folder / layout.DECISIONS
    logs = [own] if own.exists() else sorted(folder.rglob(layout.DECISIONS))
    return [seconds for log in logs for seconds in _of_steps(log)]


def _of_steps(log: Path) -> Iterator[float]:
    """Yield what each question's reply took: of those that were asked for together once, of a commander's word none."""
    counted: set[int] = set()
    for decision in rows(log, Decision):
        if decision.latency_s is not None and decision.confirmed_by is UNSET and decision.step not in counted:
            counted.add(decision.step)
            yield decision.latency_s


def _of_csv(path: Path) -> list[float]:
    if path.stat().st_size > BYTES_MAX:
        raise UsageError(f"--latency trace:{path} is too long for {TRACE_MAX:,} latencies. Shorten it")
    try:
        lines = [line for line in csv.reader(path.read_text(encoding="utf-8").splitlines()) if line]
    except (ValueError, csv.Error):
        raise UsageError(f"--latency trace:{path} is neither a CSV file nor a run folder") from None
    if not lines:
        return []
    head = [cell.strip() for cell in lines[0]]
    if COLUMN in head:
        column, lines = head.index(COLUMN), lines[1:]
    elif len(head) == 1:
        column = 0
    else:
        raise UsageError(f"--latency trace:{path} has several columns, but no column {COLUMN}. Name one so")
    return [_number(path, number, line, column) for number, line in enumerate(lines, 1)]


def _number(path: Path, number: int, line: list[str], column: int) -> float:
    try:
        return float(line[column])
    except (ValueError, IndexError):
        raise UsageError(
            f"--latency trace:{path} has a value that is not a number of seconds: latency {number}"
        ) from None
