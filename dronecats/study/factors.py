"""The registry of factors: the properties of a flight that a study can vary, and the functions that set a level.

Factors of pictures, wire, vehicle and light are declared in `dronecats/flight/spec/disturbances.py`. Factors are set in
the order of the registry, so a rate is set before its jitter.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dronecats.agent.latency import CAP, FIXED, JITTER, KINDS, RATE, STALL, split_policy
from dronecats.agent.models.rows import model_of
from dronecats.bench.matrix import COMMANDS, command_fields
from dronecats.flight.spec import disturbances
from dronecats.flight.spec.flight_spec import FlightSpec, latency_policy, portable_policy_text
from dronecats.pilots import roster
from foundation.declaration import DeclaredNumber
from foundation.errors import UsageError
from foundation.run_folder.results import Level
from foundation.wording import did_you_mean, nearest

ENTRANT_FACTORS = ("pilot", "model", "agent", "command")  # factors that choose the entrant
REPLY_TIME, PILOT = "the reply time", "the pilot"
POLICY = "latency_policy"  # the factor whose levels may name a file
ADDED = {"rate_cap": CAP, "reply_stall_share": STALL}  # factor → kind of the part that it adds to a latency policy
SLOWEST_HZ = 0.01  # lowest level of factors that are rates of replies
NUMBER_FORMAT = ".12g"  # for numbers in names and policies


@dataclass(frozen=True, slots=True, kw_only=True)
class Factor:
    """A property of a flight that a study sets to several levels.

    `put` is pure: it returns a flight at a level, or raises UsageError.
    """

    name: str  # as in files and options
    help: str  # its meaning, one line
    sets: str  # the property that it sets; a study has at most one factor per property
    put: Callable[[FlightSpec, Level], FlightSpec] | None = None  # None: a disturbance, see `at_levels`
    get: Callable[[FlightSpec], float | None] = lambda flight: None  # a flight's level; None: no number
    quantity: DeclaredNumber | None = None  # for numeric levels
    words: Sequence[str] | None = None  # allowed words; None without a quantity: any word
    refines: str = ""  # name of another factor; while that factor is 0, this one has no effect
    beside: bool = False  # whether a study must also set the factor in `refines`
    real_time: bool = False  # whether the factor has no effect in lockstep

    @property
    def unit(self) -> str:
        """The unit of the levels; empty if there is none."""
        return self.quantity.unit if self.quantity else ""

    def level(self, value: object) -> Level:
        """Return a value as a level. Raises UsageError for an invalid value."""
        if self.quantity is not None:
            return self.quantity.read(value)
        if not isinstance(value, str) or not value or (self.words is not None and value not in self.words):
            wanted = f"one of {', '.join(self.words)}" if self.words else "a word"
            raise UsageError(f"{self.name} must be {wanted}, got {value!r:.60}")
        return value

    def at(self, flight: FlightSpec, level: Level) -> FlightSpec:
        """Return the flight at a level. Raises UsageError, with the factor's name, if the flight does not allow it."""
        try:
            return self.put(flight, level) if self.put else flight
        except UsageError as error:
            raise UsageError(f"{self.name} at {level_text(level)}: {error}") from None


def level_text(level: Level) -> str:
    """Return a level as text for names and policies."""
    return level if isinstance(level, str) else format(level, NUMBER_FORMAT)


def _put_pilot(flight: FlightSpec, level: Level) -> FlightSpec:
    name = roster.check(str(level))
    return _with_pictures(replace(flight, pilot=name, model=None), roster.needs_pictures(name))


def _put_model(flight: FlightSpec, level: Level) -> FlightSpec:
    return _with_pictures(replace(flight, pilot=None, model=model_of(str(level))), True)


def _with_pictures(flight: FlightSpec, looks: bool) -> FlightSpec:
    """Return the flight with rendering on, except in lockstep with a pilot that does not look at pictures."""
    if flight.simulated is None:
        return flight
    return replace(flight, simulated=replace(flight.simulated, rendered=looks or flight.simulated.speed is not None))


def _word(name: str, text: str, put: Callable[[FlightSpec, Level], FlightSpec], **more: Any) -> Factor:
    return Factor(name=name, help=text, put=put, **{"sets": name, **more})


def _put_policy(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, latency=latency_policy(str(level), flight.latency.trace))


def _latency(
    name: str, text: str, kind: str, place: int, put: Callable[[FlightSpec, Level], FlightSpec], **more: Any
) -> Factor:
    """Return a factor that sets one number of a latency policy; `place` is the index of the number."""
    bounds = {"low": more.pop("low")} if "low" in more else {}
    quantity = replace(KINDS[kind].quantities[place], name=name, help=text, **bounds)
    numbers = {"get": lambda flight: dict(enumerate(flight.latency.numbers(kind))).get(place)}
    return Factor(name=name, help=text, put=put, quantity=quantity, **{"sets": name, **numbers, **more})


def _put_alone(kind: str) -> Callable[[FlightSpec, Level], FlightSpec]:
    """Return a function that replaces the latency policy by a single part of this kind."""
    return lambda flight, level: replace(flight, latency=latency_policy(f"{kind}:{level_text(level)}"))


def _put_jitter(place: int) -> Callable[[FlightSpec, Level], FlightSpec]:
    """Return a function that sets one number of `jitter:HZ,CV,RHO` and keeps the numbers before it."""

    def put(flight: FlightSpec, level: Level) -> FlightSpec:
        paced = next((part for part in flight.latency.parts if part.kind in (RATE, JITTER)), None)
        before = paced.text.partition(":")[2].split(",") if paced else []
        if len(before) < place:
            wanted = "jitter_cv" if before else "a rate"
            raise UsageError(f"it needs {wanted}. Vary {wanted} too, or hold it at one level")
        text = f"{JITTER}:{','.join([*before[:place], level_text(level)])}"
        return replace(flight, latency=flight.latency.with_part(text, (RATE, JITTER)))

    return put


def _put_part(template: str) -> Callable[[FlightSpec, Level], FlightSpec]:
    """Return a function that adds a part to the latency policy, with the level in place of `{}`."""
    return lambda flight, level: replace(flight, latency=flight.latency.with_part(template.format(level_text(level))))


def _put_stall_length(flight: FlightSpec, level: Level) -> FlightSpec:
    stall = flight.latency.part(STALL)
    if stall is None:
        raise UsageError("it needs reply_stall_share. Vary reply_stall_share too, or hold it at one level")
    share = stall.text.partition(":")[2].partition(",")[0]
    return replace(flight, latency=flight.latency.with_part(f"{STALL}:{share},{level_text(level)}"))


def _disturbance(level: disturbances.DisturbanceLevel | disturbances.DisturbanceWord) -> Factor:
    if isinstance(level, disturbances.DisturbanceWord):
        return Factor(name=level.name, help=level.help, sets=level.name, words=level.words)
    return Factor(
        name=level.name,
        help=level.help,
        sets=level.name,
        get=lambda flight: flight.disturbances.level(level.name),
        quantity=level,
        refines=level.refines,
        beside=level.beside,
        real_time=level.real_time,
    )


_FACTORS = (
    _word("pilot", "a built-in pilot", _put_pilot, sets=PILOT),
    _word("model", "a row of `dronecats models list`, or PROVIDER/NAME", _put_model, sets=PILOT),
    _word("agent", "`paper`, or another of the agents", lambda flight, level: replace(flight, agent=str(level))),
    _word("command", "how a fleet is commanded", lambda flight, level: replace(flight, **command_fields(str(level))),
          words=COMMANDS),
    _latency("latency", "the same time for every reply", FIXED, 0, _put_alone(FIXED), sets=REPLY_TIME),
    _word(POLICY, "a policy for the time of replies, as in `--latency`, for example `lognormal:0.5,0.6`", _put_policy,
          sets=REPLY_TIME),
    _latency("rate", "replies per second", RATE, 0, _put_alone(RATE), sets=REPLY_TIME, low=SLOWEST_HZ),
    _latency(
        "jitter_cv", "scatter of reply times around 1 / `rate`: standard deviation divided by mean", JITTER, 1,
        _put_jitter(1),
    ),
    _latency(
        "jitter_rho", "correlation of the times of successive replies", JITTER, 2, _put_jitter(2),
        refines="jitter_cv",
    ),
    _latency("rate_cap", "highest number of replies per second", CAP, 0, _put_part(f"{CAP}:{{}}"), low=SLOWEST_HZ),
    _latency(
        "reply_stall_share", "share of replies that hang, for 1 s unless reply_stall_length is set", STALL, 0,
        _put_part(f"{STALL}:{{}},1"), refines="reply_stall_length",
    ),
    _latency("reply_stall_length", "duration of each hang", STALL, 1, _put_stall_length, refines="reply_stall_share"),
    *(_disturbance(level) for _, _, level in disturbances.LEVELS),
)  # fmt: skip
FACTORS: Mapping[str, Factor] = {factor.name: factor for factor in _FACTORS}


def factor_of(name: str) -> Factor:
    """Return the factor with this name. Raises UsageError for an unknown name; the error suggests the nearest one."""
    factor = FACTORS.get(name.replace("-", "_"))
    if factor is None:
        near = nearest(name, FACTORS, count=1)
        hint = did_you_mean(near) if near else f"choose one of {', '.join(FACTORS)}"
        raise UsageError(f"factor '{name:.60}' is not known: {hint}")
    return factor


def check_together(names: list[str]) -> None:
    """Raise UsageError if two factors set the same property of a flight."""
    by_property: dict[str, str] = {}
    for name in names:
        first = by_property.setdefault(factor_of(name).sets, name)
        if first != name:
            raise UsageError(f"{first} and {name} both set {factor_of(name).sets}. Leave one of them out")


def stored_levels(levels: Mapping[str, Level]) -> dict[str, Level]:
    """Return the levels for study.json, in which a name replaces the path of a file of recorded latencies.

    The file may exist on one machine only. `at_levels` accepts paths and names; for a name, the flight must contain the
    latencies. Raises UsageError if a file cannot be read.
    """
    return {name: portable_policy_text(str(level)) if name == POLICY else level for name, level in levels.items()}


def at_levels(flight: FlightSpec, levels: Mapping[str, Level]) -> FlightSpec:
    """Return a flight at these levels, which replace earlier levels of the same factors.

    Raises UsageError for levels that contradict each other.
    """
    lockstep = flight.simulated is not None and flight.simulated.speed is None
    _check_combination(levels, lockstep=lockstep)
    for name, factor in FACTORS.items():
        if name in levels:
            flight = factor.at(flight, levels[name])
    disturbed = {name: level for name, level in levels.items() if not FACTORS[name].put}
    # set all disturbances at once: a delay must agree with the new rate, not with the old one
    return replace(flight, disturbances=flight.disturbances.with_levels(disturbed)) if disturbed else flight


def _check_combination(levels: Mapping[str, Level], *, lockstep: bool) -> None:
    """Raise UsageError for factors that cannot be combined.

    These are a factor without the factor that it refines, a real-time factor in lockstep, and a factor that the latency
    policy also sets.
    """
    for name, level in levels.items():
        factor = FACTORS[name]
        if factor.beside and factor.refines not in levels:
            needed = factor.refines
            raise UsageError(
                f"{name} at {level_text(level)} needs {needed}. Vary {needed} too, or hold it at one level"
            )
        if factor.real_time and lockstep:
            raise UsageError(f"{name} needs --speed N: {disturbances.LOCKSTEP}")
    policy = str(levels.get(POLICY, ""))
    kinds = {part.partition(":")[0] for part in split_policy(policy)}
    if added := next((name for name, kind in ADDED.items() if name in levels and kind in kinds), None):
        raise UsageError(f"{added} and {POLICY} {policy} both set {ADDED[added]}. Leave one of them out")
