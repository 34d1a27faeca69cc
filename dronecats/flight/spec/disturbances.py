"""Disturbances of a simulated flight: of its pictures, its wire and its vehicle. Seeded, in vehicle time.

A disturbance is declared once, on the field that holds it. From the declaration come its option on the command line,
its word in a bench.toml, its factor in a study, its bounds, its words in run.json and its row in docs/disturbances.md.
The code that applies it reads the field: of pictures `dronecats/agent/pictures.py`, of the wire
`dronecats/flight/stages/stage.py`, of the vehicle `dronecats/flight/sitl/simulation.py`. The defaults disturb
nothing. The time that a reply takes is declared in `dronecats/agent/latency.py`.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from foundation.declaration import Declaration, DeclaredNumber, check_bounds, declarations, declared, words_of
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.wording import did_you_mean, nearest
from hil.impairment import Impairment

T = TypeVar("T")
FieldValues = dict[str, Any]  # of a part of the disturbances, by field
PERFECT = Impairment()
LOSS_MAX = 0.95  # share of lost telemetry above which no decision is made, so that there is nothing to score
RECALL_S = 15.0  # s; the logger measures a picture that was taken up to 20 s ago
LOCKSTEP = "in lockstep the simulator waits for the host"


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceOption:
    """An option of the command line, which is a word of the same name in a bench.toml."""

    name: str  # "frame_delay" of --frame-delay
    metavar: str
    help: str
    more: str = ""  # what else its row of the docs says
    read: Callable[[str], FieldValues] | None = None  # text → fields; None: it takes the field's number

    @property
    def kind(self) -> type[float] | type[str]:
        """Type of its value."""
        return str if self.read else float


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceLevel(DeclaredNumber):
    """A number that a study can vary."""

    put: Callable[[FieldValues, float], None] | None = None  # sets it among the values of its part; None: as the field
    get: Callable[[Any], float] | None = None  # reads it from its part; None: as the field
    refines: str = ""  # another number without which, or where that is 0, this one has no effect
    beside: bool = False  # a study has to set that other number, too
    real_time: bool = False  # has no effect in lockstep


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance(Declaration):
    """The declaration of a disturbance."""

    option: DisturbanceOption | None = None
    levels: tuple[DisturbanceLevel, ...] = ()


def _disturbance(
    default: T,
    name: str,
    help: str,
    *,
    words: str,
    metavar: str = "",
    more: str = "",
    option: DisturbanceOption | None = None,
    first: bool = False,
    **level_fields: Any,
) -> T:
    """Return the field of a disturbance that is one number: an option and a factor of the same name.

    `metavar`: of the option; empty where there is none of this name. `more`: for the docs. `level_fields`: the bounds,
    the unit and what else a `DisturbanceLevel` has.
    """
    level = DisturbanceLevel(name=name, help=help, **level_fields)
    if metavar:
        option = DisturbanceOption(name=name, metavar=metavar, help=help, more=more)
    return declared(default, Disturbance(quantity=level, words=words, first=first, option=option, levels=(level,)))


def _pair(name: str, text: str, wanted: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in text.split(","))
        if not math.isfinite(first + second):
            raise ValueError
    except ValueError:
        raise UsageError(f"--{name} must be {wanted}; got '{text}'") from None
    return first, second


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFaults:
    """Faults of pictures between the camera and the agent."""

    delay_s: float = _disturbance(
        0.0, "frame_delay", "time from the shutter until the agent has the image", high=60.0, unit="s",
        words="pictures come {value:g} s late", metavar="S",
    )  # fmt: skip
    dropped: float = _disturbance(
        0.0, "frame_drop", "share of images that never arrive", high=0.95,
        words="{percent:g} % of pictures never come", metavar="P", more="the agent waits for the next image",
    )  # fmt: skip
    stale: float = _disturbance(
        0.0, "frame_stale", "share of questions that get the previous question's image", high=1.0,
        words="{percent:g} % of questions have the picture of the question before", metavar="P",
    )  # fmt: skip
    rate_hz: float | None = _disturbance(  # None: a picture is taken when it is asked for
        None, "frame_rate", "rate at which the camera takes images", low=0.1, high=100.0, unit="Hz",
        words="pictures are taken {value:g} times a second", first=True, metavar="HZ",
        more="the agent takes the newest one at once; without the option, an image is taken on request",
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Raise UsageError for what no camera does."""
        check_bounds(self)
        if self.reach_s > RECALL_S:
            raise UsageError(
                f"frame_delay and one period of frame_rate can have {RECALL_S:g} s together at most, got"
                f" {self.reach_s:g}"
            )

    @property
    def reach_s(self) -> float:
        """The greatest age (s) of a picture when it is requested; 0 without a rate."""
        return 0.0 if self.rate_hz is None else self.delay_s + 1.0 / self.rate_hz


WAYS = {"to": ("to_vehicle",), "from": ("from_vehicle",), "": ("to_vehicle", "from_vehicle")}
WIRE = {entry.quantity.name: name for name, entry in declarations(Impairment).items() if entry.quantity}
WIRE_LEVELS = ("delay", "jitter", "loss", "duplicate", "reorder", "baud")  # that are factors of a study


def _read_wire(text: str) -> FieldValues:
    """Return both ways of the wire of `delay=0.1,loss=0.05,to.delay=0.2`; a name alone is for both ways."""
    ways: dict[str, FieldValues] = {"to_vehicle": {}, "from_vehicle": {}}
    for word in sorted(text.split(","), key=lambda word: "." in word.partition("=")[0]):  # one way overrides both
        name, equals, value = word.strip().partition("=")
        way, dot, quantity = name.rpartition(".")
        if not equals or quantity not in WIRE or way not in WAYS or (dot and not way):
            near = nearest(quantity, WIRE) if equals else []
            raise UsageError(
                f"--link must be NAME=VALUE,… with the names {', '.join(WIRE)}, or to.NAME and from.NAME for one"
                f" direction; got '{word}'{f': {did_you_mean(near)}' if near else ''}"
            )
        is_whole = declarations(Impairment)[WIRE[quantity]].quantity.whole
        try:
            number = int(value) if is_whole else float(value)
        except ValueError:
            wanted = "a whole number" if is_whole else "a number"
            raise UsageError(f"--link needs {wanted} in '{word}'") from None
        for entry in WAYS[way]:
            ways[entry][WIRE[quantity]] = number
    return {way: Impairment(**values) for way, values in ways.items()}


def _wire_level(name: str) -> DisturbanceLevel:
    """Return a number of the wire, both ways."""
    quantity = declarations(Impairment)[WIRE[name]].quantity

    def put(values: FieldValues, level: float) -> None:
        for way in WAYS[""]:
            values[way] = replace(values[way], **{WIRE[name]: level})

    return DisturbanceLevel(
        name=f"link_{name}",
        help=f"{quantity.help}, each way",
        low=quantity.low,
        high=LOSS_MAX if name == "loss" else quantity.high,
        unit=quantity.unit,
        whole=quantity.whole,
        put=put,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkFaults:
    """Faults of the MAVLink wire between agent and autopilot, each way."""

    to_vehicle: Impairment = declared(  # noqa: RUF009  # a field
        PERFECT,
        Disturbance(
            option=DisturbanceOption(
                name="link", metavar="NAME=VALUE,…",
                help="faults of the MAVLink link: delay=0.1,loss=0.05,to.jitter=0.02 …",
                read=_read_wire, more="see below",
            ),
            levels=tuple(_wire_level(name) for name in WIRE_LEVELS),
        ),
    )  # fmt: skip
    from_vehicle: Impairment = PERFECT

    def __post_init__(self) -> None:
        """Raise UsageError for a wire on which nobody could fly."""
        if self.from_vehicle.loss > LOSS_MAX:
            raise UsageError(
                f"an agent cannot fly without telemetry: the loss from the vehicle must be 0 to {LOSS_MAX:g}, got"
                f" {self.from_vehicle.loss:g}. To lose everything in the other direction only: to.loss=1"
            )

    @property
    def words(self) -> Iterator[str]:
        """The faults in words: once where both ways are the same."""
        ways = {"to the vehicle": self.to_vehicle, "from the vehicle": self.from_vehicle}
        for way, wire in {"both ways": self.to_vehicle}.items() if len({*ways.values()}) == 1 else ways.items():
            if words := " and ".join(words_of(wire)):
                yield f"the wire {way} has {words}"


def _speed(wind_ned: Vec3) -> float:
    return math.hypot(*wind_ned)


def _blow(values: FieldValues, speed: float) -> None:
    values["wind_ned"] = (speed, 0.0, 0.0)


def _turn(values: FieldValues, towards_deg: float) -> None:
    """Turn a wind that blows north."""
    speed, turned = values["wind_ned"][0], math.radians(towards_deg)
    north, east = (round(speed * share(turned), 6) for share in (math.cos, math.sin))
    if math.hypot(north, east) > speed:  # the strongest wind must not be rounded beyond its bound
        north, east = (math.trunc(speed * share(turned) * 1e6) / 1e6 for share in (math.cos, math.sin))
    values["wind_ned"] = (north + 0.0, east + 0.0, 0.0)  # + 0.0: no zero has a sign


def _wind_words(wind_ned: Vec3) -> str:
    north, east, down = wind_ned
    return f"wind of {north:g} m/s north and {east:g} m/s east" + (f" and {down:g} m/s down" if down else "")


WIND: dict[str, Any] = {"name": "wind", "high": 30.0, "unit": "m/s"}
STALLS = "a share of seconds and how long each lasts, for example 0.1,0.5"


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleFaults:
    """Disturbances of the vehicle, under our autopilot or a PX4."""

    wind_ned: Vec3 = declared(  # noqa: RUF009  # m/s, steady, the direction that the air moves to
        (0.0, 0.0, 0.0),
        Disturbance(
            quantity=DeclaredNumber(**WIND, help="speed of the air"),
            size=_speed,
            words=_wind_words,
            option=DisturbanceOption(
                name="wind", metavar="N,E", help="m/s that the air moves north and east, for example --wind=-4,3",
                more="the speed is at most 30",
                read=lambda text: {"wind_ned": (*_pair("wind", text, "N,E in m/s, for example 4,-3"), 0.0)},
            ),
            levels=(
                DisturbanceLevel(
                    **WIND, help="steady horizontal wind; it blows towards the north unless `wind_towards` is set",
                    put=_blow,
                    get=lambda part: _speed(part.wind_ned),
                ),
                DisturbanceLevel(
                    name="wind_towards", high=360.0, unit="°",
                    help="direction towards which the wind blows; 0 is north, 90 east",
                    put=_turn, refines="wind", beside=True,
                ),
            ),
        ),
    )  # fmt: skip
    gusts_w20: float = _disturbance(
        0.0, "gusts", "Dryden gusts (MIL-F-8785C); the value is the wind speed 20 ft above the ground", high=30.0,
        unit="m/s", words="gusts of a wind of {value:g} m/s at 20 ft", metavar="W20",
        more="7.7 is light, 15.4 moderate, 23 severe",
    )  # fmt: skip
    payload_kg: float = _disturbance(
        0.0, "payload", "mass of a load for which the autopilot is not tuned", high=20.0, unit="kg",
        words="a payload of {value:g} kg", metavar="KG",
        more="the load hangs halfway down the legs; gains and hover thrust remain those of the bare airframe",
    )  # fmt: skip
    gps_delay_s: float = _disturbance(
        0.0, "gps_delay", "how much older GPS fixes are than their time stamps", high=1.4, unit="s",
        words="fixes are {value:g} s older than they say", metavar="S",
        more="the autopilot does not correct for the delay, so its estimate lags behind the motion",
    )  # fmt: skip
    gps_noise: float = _disturbance(
        1.0, "gps_noise", "factor on the position and velocity errors of GPS fixes", high=100.0, unit="×",
        words="GPS noise × {value:g}", metavar="X",
        more="the factor begins with the episode and also multiplies slow errors, so the position jumps at that time; "
        "the accuracy that the GPS reports stays the same",
    )  # fmt: skip
    estimator_noise: float = _disturbance(
        1.0, "sensor_noise", "factor on noise and drift of gyroscope, accelerometer, compass and barometer",
        high=100.0, unit="×", words="sensor noise × {value:g}", metavar="X",
        more="the factor begins with the episode, so the height of the barometer jumps at that time",
    )  # fmt: skip
    setpoint_hz: float | None = _disturbance(  # None: 20. Below 2 Hz a PX4 leaves offboard
        None, "setpoint_rate", "how often the agent sends its setpoint", low=2.0, high=50.0, unit="Hz",
        words="{value:g} setpoints a second", metavar="HZ",
        more="in vehicle time; the default is 20; if the rate is above 20, telemetry comes at the same rate",
    )  # fmt: skip
    stalled: float = _disturbance(
        0.0, "stall_share", "share of the seconds at whose start the host stalls the simulator", high=1.0,
        words="the simulator stands still for {owner.stall_s:g} s in {percent:g} % of seconds", real_time=True,
        refines="stall_length",
        option=DisturbanceOption(
            name="host_stalls", metavar="P,S",
            help="at the start of each second, stall the simulator with probability P, for S seconds",
            more="the seconds that begin are those of vehicle time; S is wall time; real time only",
            read=lambda text: dict(zip(("stalled", "stall_s"), _pair("host-stalls", text, STALLS), strict=True)),
        ),
    )  # fmt: skip
    stall_s: float = _disturbance(
        0.5, "stall_length", "length of each stall of the simulator", high=10.0, unit="s", words="", real_time=True,
        refines="stall_share",
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Raise UsageError for what no flight bears."""
        check_bounds(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbances:
    """All of them together."""

    frame: FrameFaults = FrameFaults()
    link: LinkFaults = LinkFaults()
    vehicle: VehicleFaults = VehicleFaults()

    @property
    def words(self) -> str | None:
        """The disturbances in words, joined by commas, for run.json and reports; None without any."""
        return ", ".join([*words_of(self.frame), *self.link.words, *words_of(self.vehicle)]) or None

    def with_options(self, options: Mapping[str, Any]) -> "Disturbances":
        """Return these with what options say otherwise, name → number or text; None: not set. Raises UsageError."""
        values = self._values()
        for part, name, disturbance in DECLARED:
            option = disturbance.option
            if option and (value := options.get(option.name)) is not None:
                values[part] |= option.read(value) if option.read else {name: float(value)}
        return _made(values)

    def with_levels(self, levels: Mapping[str, float]) -> "Disturbances":
        """Return these with numbers at a study's levels, by name. Raises UsageError."""
        values = self._values()
        for part, name, level in LEVELS:
            if level.name in levels:
                if level.put:
                    level.put(values[part], levels[level.name])
                else:
                    values[part][name] = levels[level.name]
        return _made(values)

    def level(self, name: str) -> float:
        """Return the number of a study's level as it is here."""
        part, of, level = next(entry for entry in LEVELS if entry[2].name == name)
        value = getattr(self, part)
        return level.get(value) if level.get else float(getattr(value, of))

    def _values(self) -> dict[str, FieldValues]:
        return {
            name: {field.name: getattr(getattr(self, name), field.name) for field in fields(of)}
            for name, of in _SECTIONS.items()
        }

    def check_clock(self, *, lockstep: bool) -> None:
        """Raise UsageError for what has no effect on a clock that waits."""
        if lockstep and self.vehicle.stalled:
            raise UsageError(f"--host-stalls (stall_share in a study) goes with --speed N: {LOCKSTEP}")


UNDISTURBED = Disturbances()
_SECTIONS = {"frame": FrameFaults, "link": LinkFaults, "vehicle": VehicleFaults}
DECLARED: tuple[tuple[str, str, Disturbance], ...] = tuple(  # part, field, declaration
    (part, name, disturbance) for part, of in _SECTIONS.items() for name, disturbance in declarations(of).items()
)
OPTIONS = tuple(disturbance.option for _, _, disturbance in DECLARED if disturbance.option)
LEVELS = tuple((part, name, level) for part, name, disturbance in DECLARED for level in disturbance.levels)


def _made(values: Mapping[str, FieldValues]) -> Disturbances:
    sections: FieldValues = {name: of(**values[name]) for name, of in _SECTIONS.items()}
    return Disturbances(**sections)
