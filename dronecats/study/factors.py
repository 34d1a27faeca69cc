"""The registry of factors: everything that a study can vary, and how it is set on a flight.

Those of pictures, wire and vehicle are made from the declarations of `dronecats/flight/disturbances.py`. Factors are
set in the registry's order, so that a rate is there before its jitter.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dronecats.agent.latency import CAP, FIXED, JITTER, KINDS, RATE, STALL, split_policy
from dronecats.agent.models.rows import model_of
from dronecats.bench.matrix import COMMANDS, command_fields
from dronecats.flight import disturbances
from dronecats.flight.spec.flight_spec import FlightSpec, carried, latency_policy
from dronecats.pilots import roster
from foundation.declaration import DeclaredNumber
from foundation.errors import UsageError
from foundation.run_folder.benchmark import Level
from foundation.wording import did_you_mean, nearest

WHO_FLIES = ("pilot", "model", "agent", "command")  # factors that are no disturbance but an entrant
REPLY_TIME, WHO = "what a reply takes", "who flies"
POLICY = "latency_policy"  # the factor whose levels may name a file
ADDED = {"rate_cap": CAP, "reply_stall_share": STALL}  # factors that are a part of a latency policy
SLOWEST_HZ = 0.01  # of the factors that are rates of replies
SAID = ".12g"  # as numbers are written into names and policies


@dataclass(frozen=True, slots=True, kw_only=True)
class Factor:
    """Something about a flight that a study sets to one level after another.

    `put` is pure: a flight and a level give the flight at that level, or UsageError.
    """

    name: str  # as files and options have it
    help: str  # its meaning, one line
    sets: str  # what of a flight it decides: of the factors that set the same, a study has one
    put: Callable[[FlightSpec, Level], FlightSpec] | None = None  # None: one of the disturbances, set together
    get: Callable[[FlightSpec], float | None] = lambda flight: None  # the number that a flight has; None: it has none
    quantity: DeclaredNumber | None = None  # of a number; …
    words: Sequence[str] | None = None  # … and what a word may be. None of both: any word
    refines: str = ""  # another factor: where that is 0, this one has no effect
    beside: bool = False  # that other factor has to be set, too
    real_time: bool = False  # has no effect in lockstep

    @property
    def unit(self) -> str:
        """Unit of its levels, "" where they have none."""
        return self.quantity.unit if self.quantity else ""

    def level(self, value: object) -> Level:
        """Return a value as a level. Raises UsageError for what is none, in one sentence."""
        if self.quantity is not None:
            return self.quantity.read(value)
        if not isinstance(value, str) or not value or (self.words is not None and value not in self.words):
            wanted = f"one of {', '.join(self.words)}" if self.words else "a word"
            raise UsageError(f"{self.name} wants {wanted}, got {value!r:.60}")
        return value

    def at(self, flight: FlightSpec, level: Level) -> FlightSpec:
        """Return the flight at a level. Raises UsageError naming the factor where that does not go with the rest."""
        try:
            return self.put(flight, level) if self.put else flight
        except UsageError as wrong:
            raise UsageError(f"{self.name} at {said(level)}: {wrong}") from None


def said(level: Level) -> str:
    """Return a level as a name or a policy has it."""
    return level if isinstance(level, str) else format(level, SAID)


def _agent(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, agent=str(level))


def _command(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, **command_fields(str(level)))


def _pilot(flight: FlightSpec, level: Level) -> FlightSpec:
    name = roster.check(str(level))
    return _seeing(replace(flight, pilot=name, model=None), roster.looks(name))


def _model(flight: FlightSpec, level: Level) -> FlightSpec:
    return _seeing(replace(flight, pilot=None, model=model_of(str(level))), True)


def _seeing(flight: FlightSpec, looks: bool) -> FlightSpec:
    """Return the flight with pictures for a pilot that looks, and in lockstep without for one that does not."""
    if flight.simulated is None:
        return flight
    return replace(flight, simulated=replace(flight.simulated, rendered=looks or flight.simulated.speed is not None))


def _word(name: str, text: str, put: Callable[[FlightSpec, Level], FlightSpec], **more: Any) -> Factor:
    return Factor(name=name, help=text, put=put, **{"sets": name, **more})


def _policy(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, latency=latency_policy(str(level), flight.latency.trace))


def _latency(
    name: str, text: str, kind: str, place: int, put: Callable[[FlightSpec, Level], FlightSpec], **more: Any
) -> Factor:
    """Return the factor that is a number of a kind of latency policy."""
    bounds = {key: more.pop(key) for key in ("low",) if key in more}
    quantity = replace(KINDS[kind].quantities[place], name=name, help=text, **bounds)
    numbers = {"get": lambda flight: dict(enumerate(flight.latency.numbers(kind))).get(place)}
    return Factor(name=name, help=text, put=put, quantity=quantity, **{"sets": name, **numbers, **more})


def _alone(kind: str) -> Callable[[FlightSpec, Level], FlightSpec]:
    """Return what sets a policy of one kind and nothing else."""
    return lambda flight, level: replace(flight, latency=latency_policy(f"{kind}:{said(level)}"))


def _jittered(place: int) -> Callable[[FlightSpec, Level], FlightSpec]:
    """Return what sets one of the numbers of `jitter:HZ,CV,RHO`, which keeps those before it."""

    def put(flight: FlightSpec, level: Level) -> FlightSpec:
        paced = next((part for part in flight.latency.parts if part.kind in (RATE, JITTER)), None)
        before = paced.text.partition(":")[2].split(",") if paced else []
        if len(before) < place:
            wanted = "jitter_cv" if before else "a rate"
            raise UsageError(f"it goes with {wanted}: vary that too, or hold it at one level")
        text = f"{JITTER}:{','.join([*before[:place], said(level)])}"
        return replace(flight, latency=flight.latency.with_part(text, (RATE, JITTER)))

    return put


def _capped(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, latency=flight.latency.with_part(f"{CAP}:{said(level)}"))


def _hung(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, latency=flight.latency.with_part(f"{STALL}:{said(level)},1"))


def _hung_for(flight: FlightSpec, level: Level) -> FlightSpec:
    hanging = flight.latency.part(STALL)
    if hanging is None:
        raise UsageError("it goes with reply_stall_share: vary that too, or hold it at one level")
    share = hanging.text.partition(":")[2].partition(",")[0]
    return replace(flight, latency=flight.latency.with_part(f"{STALL}:{share},{said(level)}"))


def _disturbance(level: disturbances.DisturbanceLevel) -> Factor:
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


_ALL = (
    _word("pilot", "a built-in pilot", _pilot, sets=WHO),
    _word("model", "a row of `dronecats models list`, or PROVIDER/NAME", _model, sets=WHO),
    _word("agent", "`paper`, or another of the agents", _agent),
    _word("command", "how a fleet is commanded", _command, words=COMMANDS),
    _latency("latency", "what every reply takes", FIXED, 0, _alone(FIXED), sets=REPLY_TIME),
    _word(POLICY, "what a reply takes, as `--latency` has it", _policy, sets=REPLY_TIME),
    _latency("rate", "the rate at which replies are served", RATE, 0, _alone(RATE), sets=REPLY_TIME, low=SLOWEST_HZ),
    _latency("jitter_cv", "the replies' times around that rate, deviation over mean", JITTER, 1, _jittered(1)),
    _latency(
        "jitter_rho", "the correlation of one reply's time with the next one's", JITTER, 2, _jittered(2),
        refines="jitter_cv",
    ),
    _latency("rate_cap", "no reply comes sooner after the last one", CAP, 0, _capped, low=SLOWEST_HZ),
    _latency(
        "reply_stall_share", "share of replies that hang (for 1 s, unless the next says)", STALL, 0, _hung,
        refines="reply_stall_length",
    ),
    _latency("reply_stall_length", "for so long", STALL, 1, _hung_for, refines="reply_stall_share"),
    *(_disturbance(level) for _, _, level in disturbances.LEVELS),
)  # fmt: skip
FACTORS: Mapping[str, Factor] = {factor.name: factor for factor in _ALL}


def factor_of(name: str) -> Factor:
    """Return the factor of a name. Raises UsageError for any other, naming the nearest."""
    factor = FACTORS.get(name.replace("-", "_"))
    if factor is None:
        near = nearest(name, FACTORS, count=1)
        hint = did_you_mean(near) if near else f"there are {', '.join(FACTORS)}"
        raise UsageError(f"no factor is called '{name:.60}'; {hint}")
    return factor


def check_together(names: list[str]) -> None:
    """Raise UsageError when two factors set the same thing of a flight."""
    by_what: dict[str, str] = {}
    for name in names:
        what = factor_of(name).sets
        if other := by_what.get(what):
            raise UsageError(f"{other} and {name} both say {what}; leave one of them out")
        by_what[what] = name


def as_told(levels: Mapping[str, Level]) -> dict[str, Level]:
    """Return levels as study.json has them: without the file of recorded latencies, which one machine has.

    Raises UsageError where that cannot be read. `at_levels` takes both; of these it wants the latencies in the flight.
    """
    return {name: carried(str(level)) if name == POLICY else level for name, level in levels.items()}


def at_levels(flight: FlightSpec, levels: Mapping[str, Level]) -> FlightSpec:
    """Return a flight with every one of these factors at its level, whatever it had of them before.

    So the same levels once more change nothing, and other levels of the same factors leave nothing of these. Raises
    UsageError for levels that contradict.
    """
    lockstep = flight.simulated is not None and flight.simulated.speed is None
    _check_beside(levels, lockstep=lockstep)
    for name, factor in FACTORS.items():
        if name in levels:
            flight = factor.at(flight, levels[name])
    disturbed = {
        name: level for name, level in levels.items() if isinstance(level, int | float) and not FACTORS[name].put
    }
    # all at once: a delay must agree with the rate to come, not with the one before
    return replace(flight, disturbances=flight.disturbances.with_levels(disturbed)) if disturbed else flight


def _check_beside(levels: Mapping[str, Level], *, lockstep: bool) -> None:
    """Raise UsageError for a factor without the one that it refines, for one that a policy's words say, too, and more.

    In lockstep a factor that has an effect in real time only is refused.
    """
    for name, level in levels.items():
        factor = FACTORS[name]
        if factor.beside and factor.refines not in levels:
            wanted = f"it goes with {factor.refines}: vary that too, or hold it at one level"
            raise UsageError(f"{name} at {said(level)}: {wanted}")
        if factor.real_time and lockstep:
            raise UsageError(f"{name} goes with --speed N: {disturbances.LOCKSTEP}")
    policy = str(levels.get(POLICY, ""))
    kinds = {part.partition(":")[0] for part in split_policy(policy)}
    if both := next((name for name, kind in ADDED.items() if name in levels and kind in kinds), None):
        raise UsageError(f"{both} and {POLICY} {policy} both say {ADDED[both]}; leave one of them out")
