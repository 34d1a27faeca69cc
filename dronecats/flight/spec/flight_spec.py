"""All settings of a flight as one value, which can be pickled and written as JSON.

Command line, files and studies create a FlightSpec. It checks all rules between options, and raises UsageError for
contradictions.

A worker on any machine can fly the spec, because the spec holds the contents of files, such as the latencies of a
`trace:FILE`. The worker's machine needs only these files, of which the spec holds the names: the script of
`--pilot recorded:FILE`, a user's own map or agent, the program in `px4`, the key file of `Connected` and the files of
`Accounts`.
"""

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from msgspec import UNSET

from dronecats.agent.latency import MEASURED, TRACE, TRACE_MAX, LatencyPolicy, split_policy, trace_name
from dronecats.agent.models.ledger import cost_limit, token_limit
from dronecats.agent.models.replay import FlightRecording
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.names import PAPER, STEADY
from dronecats.agent.reply.reading import ReplyParser
from dronecats.flight.spec.disturbances import LOCKSTEP, UNDISTURBED, Disturbances
from foundation.declaration import ABOVE_0, Declaration, DeclaredNumber, check_bounds, declared, number
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder import layout
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision
from hil.cameras.lens import Calibration
from hil.link.envelope import SIMULATED, Limits

SCRIPTED = "scripted:divide"  # the default commander of built-in pilots
ON_CLUSTER = "ray:"  # prefix of a ledger's name, if an actor of a Ray cluster keeps the ledger
LATENCY = "fixed:0.5"  # two replies a second, like the paper's smallest model on its own server: docs/latency.md
DEFAULT_LATENCY = LatencyPolicy.parse(LATENCY)
SEED_MAX = 2**31 - 1
COUNT_MAX = 10**9
SPEED = DeclaredNumber(name="--speed", low=0.01, high=100.0, unit="× real time, or max", help="factor on real time")


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulated:
    """A simulated vehicle with its camera."""

    airframe: str = "x500"
    autopilot: Literal["ours", "px4"] = "ours"
    px4: str | None = None  # the command that starts a PX4; None: wait for a PX4
    speed: float | None = declared(1.0, Declaration(quantity=SPEED))  # × real time; None: lockstep
    rendered: bool = True  # False: grey frames, for a pilot that does not look at them
    camera: Literal["depth"] | None = None  # depth: a depth picture with each RGB picture, for a user's own agent
    optics: dict[str, Any] | None = None  # lens, sensor and weather (docs/cameras.md); None: as in the benchmark

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.px4 and self.autopilot != "px4":
            raise UsageError("--px4 goes with --autopilot px4. Add it, or leave --px4 out")
        if self.camera and self.optics:
            raise UsageError("--depth does not go with --optics, which changes the image only. Leave one of them out")


@dataclass(frozen=True, slots=True, kw_only=True)
class Authority:
    """The agent's permissions on a vehicle. A simulated vehicle grants all (the defaults)."""

    arm: bool = True  # False: a person arms, takes off and hands over
    then: Literal["land", "return", "hold"] = "land"  # action at the end of the flight, after the vehicle has stopped
    dry: bool = False  # decide, but move nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Connected:
    """A connected vehicle: a real one, or one that simulates itself and sends its true poses."""

    url: str  # URL of the vehicle's MAVLink connection
    camera: str | None = None  # address of the vehicle's camera; None: pictures are drawn from the poses of `truth`
    calibration: Calibration | None = None
    truth: str | None = None  # URL of the vehicle's true poses
    sign: str | None = None  # file of the key for signed messages; None: unsigned messages
    authority: Authority = Authority(arm=False, then="hold")


@dataclass(frozen=True, slots=True, kw_only=True)
class Accounts:
    """Limits of the cost of models, and the files on this machine that store costs and replies."""

    cost_limit_usd: float | None = None  # $, limit for the sum of all costs in the ledger; None: no limit
    token_limit: int | None = None  # limit for all tokens of questions and replies in the ledger; None: no limit
    ledger: str | None = None  # file that stores costs, or ON_CLUSTER and a name; None: a file in the run folder
    cache: str | None = None  # file of stored replies; None: every question is sent

    def __post_init__(self) -> None:
        if self.cost_limit_usd is not None:
            cost_limit(self.cost_limit_usd)
        if self.token_limit is not None:
            token_limit(self.token_limit)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExternalHarness:
    """Another evaluation harness that asks a model and passes on its replies (`dronecats.bench.harnesses`)."""

    harness: str  # gymnasium, inspect or inspect-robots
    name: str  # the harness's name for its model
    axis_order: Literal["xy", "yx"] = "xy"  # order of the coordinates of a point
    lifted: str | None = None  # reasoning effort that the harness requests after the action `think`; None: no change


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSpec:
    """The settings of one flight, or of all flights of a run, which adds each episode's record. Raises UsageError."""

    episode: str | None = None  # id of a shipped episode
    record: dict[str, Any] | None = None  # or the content of the user's own record file
    map: str | None = None  # or only a map, with an `instruction`
    instruction: str | None = None  # for a flight without an episode
    simulated: Simulated | None = None  # either this or `connected` is set
    connected: Connected | None = None
    drones: int | None = None  # number of simulated drones; None: one for each start pose of the record
    pilot: str | None = None  # a built-in pilot; exactly one of `pilot`, `model` and `outside` is set
    model: ModelSpec | None = None
    outside: ExternalHarness | None = None
    replay: FlightRecording | None = None  # recorded replies, used instead of asking the pilot or model
    accounts: Accounts = Accounts()
    command: Literal["flat", "hierarchical", "solo"] = (
        "flat"  # flat: one question for all drones; hierarchical: a commander; solo: a question for each drone
    )
    commander: ModelSpec | None = None  # the commander's model; only with `command` hierarchical
    # name of a built-in commander. If this and `commander` are None, the commander is `model`; without it, SCRIPTED
    scripted: str | None = None
    prompt: str | None = None  # a template; None: the shipped template
    agent: str = PAPER  # a shipped agent (`dronecats.flight.run.pilot`), or MODULE:NAME of the user's own
    latency: LatencyPolicy = DEFAULT_LATENCY  # how long replies take in vehicle time: docs/latency.md
    parser: ReplyParser = "strict"  # how replies are read: docs/replies.md
    stop_unreadable: int | None = (
        number(  # the flight ends after this number of successive replies for one drone without an action; None: never
            None, "--stop-unreadable", "replies in a row that are no actions", low=1, high=COUNT_MAX, whole=True
        )
    )
    patience_s: float | None = number(  # s, longest wait for a frame or reply; None: limits of camera and model
        None, "--patience", "time without a frame or a reply", low=1.0, high=CAP_S, unit="s"
    )
    disturbances: Disturbances = UNDISTURBED  # faults of pictures, link and vehicle
    seed: int = number(0, "--seed", "tells flights of one episode apart", high=SEED_MAX, whole=True)
    seconds: float = number(CAP_S, "--seconds", "vehicle time, the flight's length", low=ABOVE_0, high=CAP_S, unit="s")
    full: bool = False  # fly to the time limit, even when the verdict is decided
    envelope: Limits | None = SIMULATED  # safety limits of the flight; None: no limits at all
    keep_ulog: bool = False  # copy PX4's own log to the episode's folder

    def __post_init__(self) -> None:
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
        if simulated.camera and self.agent in (PAPER, STEADY):
            raise UsageError(
                f"the agent {self.agent} gets one RGB image only. Leave --depth out, or name an agent of your own:"
                " --agent MODULE:NAME"
            )
        if lockstep and self.disturbances.vehicle.stalled:
            raise UsageError(f"--host-stalls (stall_share in a study) needs --speed N: {LOCKSTEP}")
        if lockstep and self.latency.real:
            raise UsageError(
                "--latency real does not go with --speed max, where the vehicle's clock waits for replies."
                " Use fixed:SECONDS"
            )
        if self.keep_ulog and not (simulated.autopilot == "px4" and simulated.px4):
            raise UsageError(
                "--keep-ulog needs --connect, or --autopilot px4 with --px4 COMMAND. Add them, or leave --keep-ulog out"
            )

    @property
    def models(self) -> tuple[ModelSpec, ...]:
        """The models that the flight asks, as pilot and as commander; a replay asks none."""
        return () if self.replay else tuple(model for model in (self.model, self.commander) if model)

    @property
    def repeats_exactly(self) -> bool:
        """Whether a second flight writes the same bytes. True in lockstep without PX4, model and `measured` latency."""
        simulated = self.simulated
        is_lockstep = simulated is not None and simulated.speed is None and simulated.autopilot != "px4"
        return is_lockstep and not self.models and self.outside is None and self.latency.part(MEASURED) is None

    @property
    def scripted_commander(self) -> str | None:
        """The built-in commander of a hierarchy; None if there is no commander, or if it is a model."""
        if self.command != "hierarchical" or self.commander or (self.model and not self.scripted):
            return None
        return self.scripted or SCRIPTED

    @property
    def pilot_name(self) -> str:
        """The built-in pilot's name, PROVIDER/NAME of a model or HARNESS:NAME; for a replay, `replay of NAME`."""
        name = self.pilot or (self.model.title if self.model else "")
        name = f"{self.outside.harness}:{self.outside.name}" if self.outside else name
        return f"replay of {name}" if self.replay else name


def _check_one(wanted: str, *values: object) -> None:
    if sum(value is not None for value in values) != 1:
        raise UsageError(f"a flight needs {wanted}. Choose one")


COLUMN = "latency_s"  # name of the column with the latencies in a CSV file
BYTES_MAX = 4_000_000
AT = "@"  # between a file's name and the digest of the latencies


def latency_policy(text: str, recorded: Sequence[float] | None = None) -> LatencyPolicy:
    """Return the policy that a text describes; read the file of a `trace:FILE`.

    `recorded`: latencies (s), used instead of the file if the text has their digest (`portable_policy_text`).
    Raises UsageError for an invalid policy, and for a file without latencies.
    """
    file = _file(text)
    if file is None:
        return LatencyPolicy.parse(text)
    trace = recorded if recorded is not None and trace_name(recorded) == digest_of(text) else read_trace(Path(file))
    return LatencyPolicy.parse(_with_file(text, lambda _: trace_name(trace)), trace)


def portable_policy_text(text: str) -> str:
    """Return the text of a policy without local paths: `trace:FILE` becomes `trace:NAME@DIGEST`.

    NAME (for people) is the file's name without its folder. DIGEST is from `trace_name`. Raises UsageError like
    `read_trace`.
    """
    return _with_file(text, lambda file: f"{Path(file).resolve().name}{AT}{trace_name(read_trace(Path(file)))}")


def from_folder(text: str, folder: Path) -> str:
    """Return the text of a policy, with a relative FILE in `trace:FILE` resolved against `folder`."""
    return _with_file(text, lambda file: str(folder / file))


def digest_of(text: str) -> str | None:
    """Return the digest of the recorded latencies in a text from `portable_policy_text`; None: it has no digest."""
    file = _file(text)
    return file.rpartition(AT)[2] if file and AT in file else None


def _file(text: str) -> str | None:
    """Return FILE of `trace:FILE`; None without a trace. Raises UsageError for an empty FILE."""
    file = next((part.partition(":")[2] for part in split_policy(text) if part.startswith(f"{TRACE}:")), None)
    if file == "":
        raise UsageError(f"--latency {text} names no file. Name a run folder or a CSV file after trace:")
    return file


def _with_file(text: str, change: Callable[[str], str]) -> str:
    """Return the text with FILE of `trace:FILE` changed; without a trace, the text itself."""
    file = _file(text)
    if file is None:
        return text
    trace = f"{TRACE}:{file}"
    return "+".join(f"{TRACE}:{change(file)}" if part == trace else part for part in split_policy(text))


def read_trace(path: Path) -> tuple[float, ...]:
    """Return the latencies (s) of a CSV file, or of a run or episode folder in the order of the steps.

    Unfinished and retried flights of a run are left out. A CSV file must have the column `latency_s`, or only one
    column. Raises UsageError.
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
    replaced = {layout.UNFINISHED, layout.RETRIED}
    logs = [log for log in logs if replaced.isdisjoint(log.relative_to(folder).parts)]
    return [seconds for log in logs for seconds in _of_steps(log)]


def _of_steps(log: Path) -> Iterator[float]:
    """Yield one latency for each step, not one for each drone; skip the confirmations of a commander."""
    counted: set[int] = set()
    for decision in rows(log, Decision):
        if decision.latency_s is not None and decision.confirmed_by is UNSET and decision.step not in counted:
            counted.add(decision.step)
            yield decision.latency_s


def _of_csv(path: Path) -> list[float]:
    if path.stat().st_size > BYTES_MAX:
        raise UsageError(f"--latency trace:{path} is too long for {TRACE_MAX:,} latencies. Shorten it")
    try:
        lines = [line for line in csv.reader(path.read_text(encoding="utf-8-sig").splitlines()) if line]
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
        raise UsageError(f"--latency trace:{path} has several columns, and none is named {COLUMN}. Rename one of them")
    return [_number(path, number, line, column) for number, line in enumerate(lines, 1)]


def _number(path: Path, number: int, line: list[str], column: int) -> float:
    try:
        return float(line[column])
    except (ValueError, IndexError):
        raise UsageError(
            f"--latency trace:{path} has a value that is not a number of seconds: latency {number}"
        ) from None
