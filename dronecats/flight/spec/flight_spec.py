"""Everything that decides what is flown, by whom and on what, as one value: it pickles, and it is JSON.

It names nothing that only one machine has, but for a script that is played, a map of one's own and the accounts' files:
what a file says is in it, not the file's name. So it is all that a worker needs, wherever that is.
"""

from dataclasses import dataclass
from typing import Any, Literal

from dronecats.agent.models.replay import FlightRecording
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.names import PAPER, STEADY
from dronecats.agent.reply.reading import ReplyParser
from dronecats.flight.spec.disturbances import UNDISTURBED, Disturbances
from foundation.protocol import CAP_S
from hil.cameras.lens import Calibration
from hil.link.envelope import SIMULATED, Limits

SCRIPTED = "scripted:divide"  # who commands built-in pilots unless somebody is named
ON_CLUSTER = "ray:"  # before the name of a ledger that an actor of a cluster keeps
LATENCY = "fixed:0.5"  # two replies a second, the paper's smallest model served alone; see docs/latency.md


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulated:
    """A vehicle of our own simulation, with its camera."""

    airframe: str = "x500"
    autopilot: Literal["ours", "px4"] = "ours"
    px4: str | None = None  # the command that starts a PX4; None: it is waited for
    speed: float | None = 1.0  # × real time; None: lockstep, as fast as it goes
    rendered: bool = True  # False: grey frames, for a pilot that does not look at them
    optics: dict[str, Any] | None = None  # lens, sensor and weather (docs/cameras.md); None: as in the benchmark


@dataclass(frozen=True, slots=True, kw_only=True)
class Authority:
    """What we may do to a vehicle besides flying it. A simulated one of our own: everything."""

    arm: bool = True  # False: a person arms, takes off and hands over
    then: Literal["land", "return", "hold"] = "land"  # what follows the hold at the end
    dry: bool = False  # decide, but move nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Connected:
    """A vehicle that somebody else started: a real one, or one that simulates itself and tells us its true poses."""

    url: str  # of its MAVLink
    camera: str | None = None  # address of its camera; None: our world, drawn where `truth` says that the vehicle is
    calibration: Calibration | None = None
    truth: str | None = None  # URL of its true poses
    sign: str | None = None  # file of the key with which its messages are signed; None: they are not
    authority: Authority = Authority(arm=False, then="hold")


@dataclass(frozen=True, slots=True, kw_only=True)
class Accounts:
    """What a model may cost, and the files of this machine on which its questions are booked."""

    cost_limit_usd: float | None = None  # $, of all that the ledger holds; None: no limit
    token_limit: int | None = None  # of questions and replies, likewise
    ledger: str | None = None  # file, or ON_CLUSTER and a name; None: a file in the run folder
    cache: str | None = None  # file of replies; None: every question is sent


@dataclass(frozen=True, slots=True, kw_only=True)
class Outside:
    """Replies come from outside: another harness asks its own model (`dronecats.bench.bridges`)."""

    harness: str  # gymnasium, inspect or inspect-robots
    name: str  # as the harness calls who answers
    axis_order: Literal["xy", "yx"] = "xy"  # in which the prompt asks for points
    lifted: str | None = (
        None  # the reasoning that the harness asks for after a `think`; None: as for any other question
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSpec:
    """One flight; or, without an episode, each flight of a run. Raises ValueError for what contradicts itself."""

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
    agent: str = PAPER  # who flies: another of `dronecats.flight.run.agents`, or MODULE:NAME of one of one's own
    latency: str = LATENCY
    latency_trace: tuple[float, ...] | None = None  # s, of a `trace:`, as they were recorded one after the other
    parser: ReplyParser = "strict"  # how replies are read: docs/replies.md
    stop_unreadable: int | None = None  # replies in a row that are no actions and end the flight; None: none do
    patience_s: float | None = None  # s without a frame or a reply after which the flight ends; None: theirs
    disturbances: Disturbances = UNDISTURBED  # of pictures, wire and vehicle, on purpose
    seed: int = 0  # tells flights of one episode apart
    seconds: float = CAP_S  # s of vehicle time, the length of the flight
    full: bool = False  # fly to its end although the verdict is decided
    envelope: Limits | None = SIMULATED  # None: no limits at all
    keep_ulog: bool = False  # keep the log that a PX4 writes on board in the episode's folder

    def __post_init__(self) -> None:
        """Look that it is one flight."""
        _one("simulated or connected", self.simulated, self.connected)
        _one("pilot, model or outside", self.pilot, self.model, self.outside)
        if sum(place is not None for place in (self.episode, self.record, self.map)) > 1:
            raise ValueError("it wants one of episode, record or map, and has more")
        if self.commander and self.scripted:
            raise ValueError("it wants one commander, and has two")
        if (self.commander or self.scripted) and self.command != "hierarchical":
            raise ValueError(f"a commander goes with command hierarchical, not {self.command}")
        if self.command == "hierarchical" and self.agent == STEADY:
            raise ValueError(f"agent {STEADY} goes with command flat or solo, not hierarchical")
        if self.command != "flat" and self.connected:
            raise ValueError(f"command {self.command} goes with simulated: a vehicle that is connected is one")
        if self.envelope is None and self.connected:
            raise ValueError("a vehicle that is not simulated wants an envelope")
        if self.disturbances != UNDISTURBED and self.connected:
            raise ValueError("disturbances go with simulated: what is connected has its own")
        if self.disturbances.vehicle.stalled and self.simulated and self.simulated.speed is None:
            raise ValueError("a host can stall only in real time: in lockstep everything waits for everything")

        if self.keep_ulog and self.simulated and not (self.simulated.autopilot == "px4" and self.simulated.px4):
            raise ValueError("keep_ulog goes with connected, or with autopilot px4 and the command that starts it")

    @property
    def scripted_commander(self) -> str | None:
        """The built-in commander of a hierarchy, None where a model commands, or nobody."""
        if self.command != "hierarchical" or self.commander or (self.model and not self.scripted):
            return None
        return self.scripted or SCRIPTED

    @property
    def pilot_name(self) -> str:
        """The built-in pilot's name, PROVIDER/NAME of a model or HARNESS:NAME; of a replay, that of who flew it."""
        name = self.pilot or (self.model.title if self.model else "")
        name = f"{self.outside.harness}:{self.outside.name}" if self.outside else name
        return f"replay of {name}" if self.replay else name


def _one(names: str, *values: object) -> None:
    if sum(value is not None for value in values) != 1:
        raise ValueError(f"it wants one of {names}")
