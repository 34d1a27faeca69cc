"""The registry of factors: everything that a study can vary, and how it is set on a flight.

They are set in the registry's order, so that of those that refine one another (a rate, then its jitter; a wind, then
its direction) the one that is refined comes first.
"""

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from dronecats.agent.latency import CAP, FASTEST_HZ, parts_of
from dronecats.agent.latency_draws import LONGEST_S
from dronecats.agent.models.rows import model_of
from dronecats.bench.matrix import COMMANDS, commanded
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.latency_trace import carried, latency_fields
from dronecats.pilots import roster
from dronecats.study.factor import Factor, said
from foundation.errors import UsageError
from foundation.run_folder.benchmark import Level

Put = Callable[[FlightSpec, Level], FlightSpec]

WHO_FLIES = ("pilot", "model", "agent", "command")  # factors that are no disturbance but an entrant
REPLY_TIME, WHO = "what a reply takes", "who flies"
POLICY = "latency_policy"  # the factor whose levels may name a file
# kinds of latency policies: rate:HZ, jitter:HZ,CV or jitter:HZ,CV,RHO around it; beside others cap:HZ, and stall:P,D
RATE, JITTERED, HANGING = "rate", "jitter", "stall"
ADDED = {"rate_cap": CAP, "reply_stall_share": HANGING}  # factors that are a part of a policy


def _frame(field: str) -> Put:
    return _disturbed("frame", field)


def _vehicle(field: str) -> Put:
    return _disturbed("vehicle", field)


def _disturbed(part: str, field: str) -> Put:
    def put(flight: FlightSpec, level: Level) -> FlightSpec:
        now = flight.disturbances
        return replace(flight, disturbances=replace(now, **{part: replace(getattr(now, part), **{field: level})}))

    return put


def _link(field: str) -> Put:
    """Return what sets a field of the wire, each way."""

    def put(flight: FlightSpec, level: Level) -> FlightSpec:
        wire = flight.disturbances.link
        told: dict[str, Any] = {field: level}
        changed = replace(
            wire, to_vehicle=replace(wire.to_vehicle, **told), from_vehicle=replace(wire.from_vehicle, **told)
        )
        return replace(flight, disturbances=replace(flight.disturbances, link=changed))

    return put


def _fixed(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, latency=f"fixed:{said(level)}", latency_trace=None)


def _policy(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, **latency_fields(str(level), flight.latency_trace))


def _rate(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, latency=f"{RATE}:{said(level)}", latency_trace=None)


def _jittered(place: int) -> Put:
    """Return what sets one of the numbers of `jitter:HZ,CV,RHO`, which keeps those before it."""

    def put(flight: FlightSpec, level: Level) -> FlightSpec:
        parts = parts_of(flight.latency)
        paced = next((part for part in parts if _kind(part) in (RATE, JITTERED)), None)
        before = paced.partition(":")[2].split(",") if paced else []
        if len(before) < place:
            wanted = "jitter_cv" if before else "a rate"
            raise UsageError(f"it goes with {wanted}: vary that too, or hold it at one level")
        jitter = f"{JITTERED}:{','.join([*before[:place], said(level)])}"
        return replace(flight, latency="+".join(jitter if part is paced else part for part in parts))

    return put


def _capped(flight: FlightSpec, level: Level) -> FlightSpec:
    return _with_part(flight, CAP, said(level))


def _hung(flight: FlightSpec, level: Level) -> FlightSpec:
    return _with_part(flight, HANGING, f"{said(level)},1")


def _hung_for(flight: FlightSpec, level: Level) -> FlightSpec:
    hanging = next((part for part in parts_of(flight.latency) if _kind(part) == HANGING), None)
    if hanging is None:
        raise UsageError("it goes with reply_stall_share: vary that too, or hold it at one level")
    return _with_part(flight, HANGING, f"{hanging.partition(':')[2].partition(',')[0]},{said(level)}")


def _with_part(flight: FlightSpec, kind: str, numbers: str) -> FlightSpec:
    """Return the flight with a part of its policy, the last one, in the place of one of that kind that it has."""
    others = [part for part in parts_of(flight.latency) if _kind(part) != kind]
    return replace(flight, latency="+".join([*others, f"{kind}:{numbers}"]))


def _kind(part: str) -> str:
    return part.partition(":")[0]


def _wind(flight: FlightSpec, level: Level) -> FlightSpec:
    return _blowing(flight, float(level), 0.0)


def _wind_towards(flight: FlightSpec, level: Level) -> FlightSpec:
    """Return the flight with its wind turned. It blows north until then: with this factor goes `wind`."""
    speed, _, _ = flight.disturbances.vehicle.wind_ned
    return _blowing(flight, speed, math.radians(float(level)))


def _blowing(flight: FlightSpec, speed: float, towards: float) -> FlightSpec:
    """Return the flight in a level wind: m/s, rad from north."""
    north, east = (round(speed * each(towards), 6) for each in (math.cos, math.sin))
    if math.hypot(north, east) > speed:  # the strongest wind must not be rounded beyond what a flight bears
        north, east = (math.trunc(speed * each(towards) * 1e6) / 1e6 for each in (math.cos, math.sin))
    wind = (north + 0.0, east + 0.0, 0.0)  # no nought has a sign
    return _vehicle("wind_ned")(flight, wind)  # type: ignore[arg-type]  # the one level that is three numbers


def _agent(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, agent=str(level))


def _command(flight: FlightSpec, level: Level) -> FlightSpec:
    return replace(flight, **commanded(str(level)))


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


def _number(name: str, unit: str, what: str, put: Put, low: float, high: float, **more: Any) -> Factor:
    return Factor(name=name, unit=unit, what=what, put=put, span=(low, high), **{"sets": name, **more})


def _word(name: str, what: str, put: Put, **more: Any) -> Factor:
    return Factor(name=name, unit="", what=what, put=put, **{"sets": name, **more})


_ALL = (
    _word("pilot", "a built-in pilot", _pilot, sets=WHO),
    _word("model", "a row of `dronecats models list`, or PROVIDER/NAME", _model, sets=WHO),
    _word("agent", "`paper`, or another of the agents", _agent),
    _word("command", "how a fleet is commanded", _command, words=COMMANDS),
    _number("latency", "s", "what every reply takes", _fixed, 0.0, LONGEST_S, sets=REPLY_TIME),
    _word(POLICY, "what a reply takes, as `--latency` has it", _policy, sets=REPLY_TIME),
    _number("rate", "Hz", "the rate at which replies are served", _rate, 0.01, FASTEST_HZ, sets=REPLY_TIME),
    _number("jitter_cv", "", "the replies' times around that rate, deviation over mean", _jittered(1), 0.0, 3.0),
    _number("jitter_rho", "", "the correlation of one reply's time with the next one's", _jittered(2), -0.99, 0.99),
    _number("rate_cap", "Hz", "no reply comes sooner after the last one", _capped, 0.01, FASTEST_HZ),
    _number("reply_stall_share", "", "share of replies that hang (for 1 s, unless the next says)", _hung, 0.0, 1.0),
    _number("reply_stall_length", "s", "for so long", _hung_for, 0.0, LONGEST_S),
    _number("frame_delay", "s", "from the shutter until the agent has the picture", _frame("delay_s"), 0.0, 60.0),
    _number("frame_drop", "", "share of pictures that never come", _frame("dropped"), 0.0, 0.95),
    _number("frame_stale", "", "share of questions that get the picture before", _frame("stale"), 0.0, 1.0),
    _number("frame_rate", "Hz", "how often pictures are taken", _frame("rate_hz"), 0.1, 100.0),
    _number("link_delay", "s", "of every message on the wire, each way", _link("delay_s"), 0.0, 60.0),
    _number("link_jitter", "s", "up to so much on top of the delay", _link("jitter_s"), 0.0, 60.0),
    _number("link_loss", "", "share of messages that are lost, each way", _link("loss"), 0.0, 0.95),
    _number("link_duplicate", "", "share of messages that arrive twice", _link("duplicate"), 0.0, 1.0),
    _number("link_reorder", "", "share of messages that are overtaken", _link("reorder"), 0.0, 1.0),
    _number("link_baud", "bit/s", "of a serial line, each way", _link("baud"), 300, 100_000_000, whole=True),
    _number("wind", "m/s", "steady and level; towards the north unless `wind_towards` says", _wind, 0.0, 30.0),
    _number("wind_towards", "°", "where the wind blows to, from north over east", _wind_towards, 0.0, 360.0),
    _number("gusts", "m/s", "Dryden gusts, the wind speed 20 ft above the ground", _vehicle("gusts_w20"), 0.0, 30.0),
    _number("payload", "kg", "a load that the autopilot was not tuned for", _vehicle("payload_kg"), 0.0, 20.0),
    _number("gps_delay", "s", "on top of the receiver's own", _vehicle("gps_delay_s"), 0.0, 1.4),
    _number("gps_noise", "×", "the receiver's own noise", _vehicle("gps_noise"), 0.0, 100.0),
    _number("sensor_noise", "×", "noise of gyroscope, accelerometer, compass, barometer",
            _vehicle("estimator_noise"), 0.0, 100.0),
    _number("setpoint_rate", "Hz", "how often the agent sends its setpoint", _vehicle("setpoint_hz"), 2.0, 50.0),
    _number("stall_share", "", "share of seconds in which the host holds the simulator up", _vehicle("stalled"),
            0.0, 1.0, real_time=True),
    _number("stall_length", "s", "for so long", _vehicle("stall_s"), 0.0, 10.0, real_time=True),
)  # fmt: skip
FACTORS: Mapping[str, Factor] = {factor.name: factor for factor in _ALL}


def factor_of(name: str) -> Factor:
    """Return the factor of a name. Raises UsageError for any other, naming the nearest."""
    found = FACTORS.get(name.replace("-", "_"))
    if found is None:
        near = difflib.get_close_matches(name, FACTORS, 1)
        meant = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(FACTORS)}"
        raise UsageError(f"no factor is called '{name:.60}'{meant}")
    return found


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
    _check_beside(levels)
    if "frame_rate" in levels:  # the delay must agree with the rate to come, not with the one before
        flight = _frame("rate_hz")(flight, None)  # type: ignore[arg-type]  # no level: pictures whenever they are asked for
    for name, factor in FACTORS.items():
        if name in levels:
            flight = factor.at(flight, levels[name])
    return flight


def _check_beside(levels: Mapping[str, Level]) -> None:
    """Raise UsageError for a factor without the one that it refines, and for one that a policy's words say, too."""
    if "wind_towards" in levels and "wind" not in levels:
        raise UsageError(
            f"wind_towards at {said(levels['wind_towards'])}: it goes with wind: vary that too, or hold it at one level"
        )
    policy = str(levels.get(POLICY, ""))
    told = {_kind(part) for part in parts_of(policy)}
    if both := next((name for name, kind in ADDED.items() if name in levels and kind in told), None):
        raise UsageError(f"{both} and {POLICY} {policy} both say {ADDED[both]}; leave one of them out")
