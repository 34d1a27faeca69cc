"""Disturbances of a simulated flight: faults (pictures, link, vehicle) and conditions (light, season).

Random disturbances are seeded. Times are vehicle time. Only the length of stalls is wall time.

Each disturbance is declared once, on a dataclass field. The declaration defines the command-line option, the key in a
bench.toml, the factor in a study, the bounds, the words in run.json and the row in docs/disturbances.md. The code that
applies the disturbance reads the field: `dronecats/agent/pictures.py` for pictures, `dronecats/flight/stages/stage.py`
for the link, `dronecats/flight/sitl/simulation.py` for the vehicle, `episodes/maps/conditions.py` for light and season.
The defaults disturb nothing. `dronecats/agent/latency.py` declares the latency of replies.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from itertools import chain
from typing import Any, Literal, TypeVar

from foundation.conditions import LOWEST_DEG, SceneConditions
from foundation.declaration import Declaration, DeclaredNumber, check_bounds, declarations, declared, words_of
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.run_folder.results import Level
from foundation.wording import did_you_mean, nearest
from hil.impairment import Impairment

T = TypeVar("T")
FieldValues = dict[str, Any]  # values of a section of `Disturbances`, by field
PERFECT = Impairment()
LOSS_MAX = 0.95  # above this share of lost telemetry there are no decisions to score
RECALL_S = 15.0  # s, upper limit of `FrameFaults.reach_s`; below the 20 s for which the logger keeps truth samples
LOCKSTEP = "in lockstep the simulator waits for the host"


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceOption:
    """An option of the command line, and the key of the same name in a bench.toml."""

    name: str  # "frame_delay" of --frame-delay
    metavar: str
    help: str
    choices: tuple[str, ...] = ()  # allowed words; (): the option takes numbers
    more: str = ""  # added to the disturbance's row in the docs
    read: Callable[[str], FieldValues] | None = None  # text → values of fields; None: the option has a number

    @property
    def kind(self) -> type[float] | type[str]:
        """Type of the option's value."""
        return str if self.read else float


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceLevel(DeclaredNumber):
    """A number that a study can vary: a factor. Without `put` and `get`, the number is the field's value."""

    put: Callable[[FieldValues, float], None] | None = None  # stores the number in the section's values
    get: Callable[[Any], float] | None = None  # returns the number from the section
    refines: str = ""  # name of another number; while that one is unset or 0, this one has no effect
    beside: bool = False  # True: a study must also set the number that `refines` names
    real_time: bool = False  # True: no effect in lockstep


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceWord:
    """A factor with words as levels. The first word is the default, which the field stores as None."""

    name: str
    help: str
    words: tuple[str, ...]

    def value(self, word: object) -> str | None:
        """Return the field's value. Raises UsageError for an unknown word."""
        if word not in self.words:
            raise UsageError(f"{self.name} must be one of {', '.join(self.words)}, got {word!r:.60}")
        return None if word == self.words[0] else str(word)


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance(Declaration):
    option: DisturbanceOption | None = None
    levels: tuple[DisturbanceLevel | DisturbanceWord, ...] = ()


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
    """Return the dataclass field of a disturbance that is one number. `name` is the name of the factor.

    With `metavar`, the field gets an option `name`. Otherwise it gets `option` (None: no option). `more`: text for the
    docs. `words`, `first`: as in `Declaration`. `level_fields`: the other fields of `DisturbanceLevel`.
    """
    level = DisturbanceLevel(name=name, help=help, **level_fields)
    if metavar:
        option = DisturbanceOption(name=name, metavar=metavar, help=help, more=more)
    return declared(default, Disturbance(quantity=level, words=words, first=first, option=option, levels=(level,)))


def _word(name: str, help: str, choices: tuple[str, ...], *, words: str, more: str = "") -> Any:
    """Return the dataclass field of a disturbance that is a word. Field, option and factor have the same name.

    The first of `choices` is the default, which the field stores as None.
    """
    level = DisturbanceWord(name=name, help=help, words=choices)
    option = DisturbanceOption(
        name=name, metavar="WORD", help=help, choices=choices, more=more,
        read=lambda text: {name: level.value(text)},
    )  # fmt: skip
    return declared(None, Disturbance(words=words, option=option, levels=(level,)))


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
        words="images arrive {value:g} s late", metavar="S",
    )  # fmt: skip
    dropped: float = _disturbance(
        0.0, "frame_drop", "share of images that never arrive", high=0.95,
        words="{percent:g} % of images never arrive", metavar="P", more="The agent waits for the next image.",
    )  # fmt: skip
    stale: float = _disturbance(
        0.0, "frame_stale", "share of steps in which the pilot gets the image of the previous step again", high=1.0,
        words="{percent:g} % of steps get the previous step's image", metavar="P",
    )  # fmt: skip
    rate_hz: float | None = _disturbance(  # None: the camera takes a picture on request
        None, "frame_rate", "rate at which the camera makes images", low=0.1, high=100.0, unit="Hz",
        words="images are taken {value:g} times a second", first=True, metavar="HZ",
        more="The agent uses the newest image, without waiting. Without this option, the agent requests each image.",
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Raise UsageError for impossible faults."""
        check_bounds(self)
        if self.reach_s > RECALL_S:
            raise UsageError(
                f"frame_delay and one period of frame_rate can have {RECALL_S:g} s together at most, got"
                f" {self.reach_s:g}"
            )

    @property
    def reach_s(self) -> float:
        """Largest age (s) of a picture when the agent requests it; 0 if the camera takes each picture on request."""
        return 0.0 if self.rate_hz is None else self.delay_s + 1.0 / self.rate_hz


# prefix of a name in --link → fields of LinkFaults
DIRECTIONS = {"to": ("to_vehicle",), "from": ("from_vehicle",), "": ("to_vehicle", "from_vehicle")}
WIRE = {entry.quantity.name: name for name, entry in declarations(Impairment).items() if entry.quantity}
WIRE_LEVELS = ("delay", "jitter", "loss", "duplicate", "reorder", "baud")  # names of --link that a study can vary


def _read_wire(text: str) -> FieldValues:
    """Return both directions of a link from `delay=0.1,loss=0.05,to.delay=0.2`. A name without prefix sets both."""
    ways: dict[str, FieldValues] = {"to_vehicle": {}, "from_vehicle": {}}
    names: set[str] = set()
    for word in sorted(
        text.split(","), key=lambda word: "." in word.partition("=")[0]
    ):  # a value for one direction overrides a value for both
        name, equals, value = word.strip().partition("=")
        way, dot, quantity = name.rpartition(".")
        if not equals or quantity not in WIRE or way not in DIRECTIONS or (dot and not way):
            near = nearest(quantity, WIRE) if equals else []
            raise UsageError(
                f"--link must be NAME=VALUE,… with the names {', '.join(WIRE)}, or to.NAME and from.NAME for one"
                f" direction; got '{word}'{f': {did_you_mean(near)}' if near else ''}"
            )
        if name in names:
            raise UsageError(f"--link has {name} twice, the second time in '{word.strip()}'. Give it once")
        names.add(name)
        is_whole = declarations(Impairment)[WIRE[quantity]].quantity.whole
        try:
            number = int(value) if is_whole else float(value)
        except ValueError:
            wanted = "a whole number" if is_whole else "a number"
            raise UsageError(f"--link needs {wanted} in '{word}'") from None
        for entry in DIRECTIONS[way]:
            ways[entry][WIRE[quantity]] = number
    return {way: Impairment(**values) for way, values in ways.items()}


def _check_queue(text: str) -> None:
    """Raise UsageError if the values of a link set a queue for a direction that has no baud."""
    names = {word.partition("=")[0].strip() for word in text.split(",")}
    for way, ways in (("", ("", "to.", "from.")), ("to.", ("", "to.")), ("from.", ("", "from."))):
        if f"{way}queue" in names and names.isdisjoint(f"{set_by}baud" for set_by in ways):
            raise UsageError(
                f"--link: {way}queue has no effect without {way}baud, because only a serial line has a queue. Add"
                f" {way}baud=57600, or leave {way}queue out"
            )


def _wire_level(name: str) -> DisturbanceLevel:
    """Return the factor that sets the number `name` of --link in both directions."""
    quantity = declarations(Impairment)[WIRE[name]].quantity

    def put(values: FieldValues, level: float) -> None:
        for way in DIRECTIONS[""]:
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
    """Faults of the MAVLink link between agent and autopilot, for each direction."""

    to_vehicle: Impairment = declared(  # noqa: RUF009  # a field
        PERFECT,
        Disturbance(
            option=DisturbanceOption(
                name="link", metavar="NAME=VALUE,…",
                help="faults of the MAVLink link: delay=0.1,loss=0.05,to.jitter=0.02 …",
                read=_read_wire, more="See below.",
            ),
            levels=tuple(_wire_level(name) for name in WIRE_LEVELS),
        ),
    )  # fmt: skip
    from_vehicle: Impairment = PERFECT

    def __post_init__(self) -> None:
        """Raise UsageError if no flight is possible because too much telemetry is lost."""
        if self.from_vehicle.loss > LOSS_MAX:
            raise UsageError(
                f"an agent cannot fly without telemetry: the loss from the vehicle must be 0 to {LOSS_MAX:g}, got"
                f" {self.from_vehicle.loss:g}. To lose everything in the other direction only: to.loss=1"
            )

    @property
    def words(self) -> Iterator[str]:
        """The faults in words: one text if both directions are the same, else one per direction."""
        ways = {"to the vehicle": self.to_vehicle, "from the vehicle": self.from_vehicle}
        for way, wire in {"both ways": self.to_vehicle}.items() if len({*ways.values()}) == 1 else ways.items():
            if words := " and ".join(words_of(wire)):
                yield f"the wire {way} has {words}"


def _speed(wind_ned: Vec3) -> float:
    return math.hypot(*wind_ned)


def _set_wind_speed(values: FieldValues, speed: float) -> None:
    values["wind_ned"] = (speed, 0.0, 0.0)


def _rotate_wind(values: FieldValues, towards_deg: float) -> None:
    """Turn a northward wind so that it blows towards `towards_deg` (°, clockwise from north)."""
    speed, turned = values["wind_ned"][0], math.radians(towards_deg)
    north, east = (round(speed * share(turned), 6) for share in (math.cos, math.sin))
    if math.hypot(north, east) > speed:  # rounding must not put the strongest wind beyond its bound
        north, east = (math.trunc(speed * share(turned) * 1e6) / 1e6 for share in (math.cos, math.sin))
    values["wind_ned"] = (north + 0.0, east + 0.0, 0.0)  # + 0.0 turns -0.0 into 0.0


def _wind_words(wind_ned: Vec3) -> str:
    north, east, down = wind_ned
    return f"wind of {north:g} m/s north and {east:g} m/s east" + (f" and {down:g} m/s down" if down else "")


WIND: dict[str, Any] = {"name": "wind", "high": 30.0, "unit": "m/s"}
STALLS = "a share of seconds and how long each lasts, for example 0.1,0.5"


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleFaults:
    """Disturbances of the vehicle. Its autopilot is the project's own or a PX4."""

    wind_ned: Vec3 = declared(  # noqa: RUF009  # m/s, steady velocity of the air
        (0.0, 0.0, 0.0),
        Disturbance(
            quantity=DeclaredNumber(**WIND, help="speed of the air"),
            size=_speed,
            words=_wind_words,
            option=DisturbanceOption(
                name="wind", metavar="N,E", help="wind velocity towards north and east, m/s, for example --wind=-4,3",
                more="The speed is at most 30.",
                read=lambda text: {"wind_ned": (*_pair("wind", text, "N,E in m/s, for example 4,-3"), 0.0)},
            ),
            levels=(
                DisturbanceLevel(
                    **WIND, help="steady horizontal wind; it blows towards the north unless `wind_towards` is set",
                    put=_set_wind_speed,
                    get=lambda part: _speed(part.wind_ned),
                ),
                DisturbanceLevel(
                    name="wind_towards", high=360.0, unit="°",
                    help="direction towards which the wind blows; 0 is north, 90 east",
                    put=_rotate_wind, refines="wind", beside=True,
                ),
            ),
        ),
    )  # fmt: skip
    gusts_w20: float = _disturbance(
        0.0, "gusts", "Dryden gusts (MIL-F-8785C); the value is the wind speed 20 ft above the ground", high=30.0,
        unit="m/s", words="gusts of a wind of {value:g} m/s at 20 ft", metavar="W20",
        more="7.7 is light, 15.4 moderate, 23 severe.",
    )  # fmt: skip
    payload_kg: float = _disturbance(
        0.0, "payload", "mass of a load for which the autopilot is not tuned", high=20.0, unit="kg",
        words="a payload of {value:g} kg", metavar="KG",
        more="The load hangs halfway down the legs. Gains and hover thrust remain those of the bare airframe.",
    )  # fmt: skip
    gps_delay_s: float = _disturbance(
        0.0, "gps_delay",
        "hidden delay of GPS fixes: each position is this many seconds older than its time stamp",
        high=1.4, unit="s",
        words="fixes are {value:g} s older than they say", metavar="S",
        more="The autopilot does not correct for the delay, so its estimate lags behind the motion.",
    )  # fmt: skip
    gps_noise: float = _disturbance(
        1.0, "gps_noise", "factor on the position and velocity errors of GPS fixes", high=100.0, unit="×",
        words="GPS noise × {value:g}", metavar="X",
        more="The factor applies from the beginning of the episode and also multiplies the slow error, so the position "
        "jumps at that time. "
        "The accuracy that the GPS reports stays the same.",
    )  # fmt: skip
    estimator_noise: float = _disturbance(
        1.0, "sensor_noise", "factor on noise and drift of gyroscope, accelerometer, compass and barometer",
        high=100.0, unit="×", words="sensor noise × {value:g}", metavar="X",
        more="The factor begins with the episode, so the height of the barometer jumps at that time.",
    )  # fmt: skip
    setpoint_hz: float | None = _disturbance(  # None: 20. Below 2 Hz PX4 leaves Offboard
        None, "setpoint_rate", "how often the agent sends its setpoint", low=2.0, high=50.0, unit="Hz",
        words="{value:g} setpoints a second", metavar="HZ",
        more="The rate is in vehicle time; the default is 20. Above 20, the agent asks for telemetry at this rate.",
    )  # fmt: skip
    stalled: float = _disturbance(
        0.0, "stall_share",
        "probability with which the host stalls the simulator at the start of each second of vehicle time",
        high=1.0,
        words="the simulator stands still for {owner.stall_s:g} s in {percent:g} % of seconds", real_time=True,
        refines="stall_length",
        option=DisturbanceOption(
            name="host_stalls", metavar="P,S",
            help="at the start of each second of vehicle time, stall the simulator with probability P, for S seconds",
            more="S is in wall time. Only in real time.",
            read=lambda text: dict(zip(("stalled", "stall_s"), _pair("host-stalls", text, STALLS), strict=True)),
        ),
    )  # fmt: skip
    stall_s: float = _disturbance(
        0.5, "stall_length", "length of each stall of the simulator", high=10.0, unit="s", words="", real_time=True,
        refines="stall_share",
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Raise UsageError for values with which no flight is possible."""
        check_bounds(self)


SUN = "AZ,EL in degrees, for example 270,15"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightConditions:
    """Light and season of the map in a flight's pictures. Declares the options for the fields of `SceneConditions`."""

    sun_azimuth_deg: float | None = _disturbance(  # None: the map's azimuth
        None, "sun_azimuth", "direction of the sun, clockwise from north", high=360.0, unit="°",
        words="the sun at azimuth {value:g}°",
        option=DisturbanceOption(
            name="sun", metavar="AZ,EL", help="place of the sun: azimuth from north and elevation in degrees",
            more=f"The elevation is {LOWEST_DEG:g} to 90. A low sun is redder, and the sky is darker.",
            read=lambda text: dict(zip(("sun_azimuth_deg", "sun_elevation_deg"), _pair("sun", text, SUN), strict=True)),
        ),
    )  # fmt: skip
    sun_elevation_deg: float | None = _disturbance(  # None: the map's elevation
        None, "sun_elevation", "height of the sun above the horizon", low=LOWEST_DEG, high=90.0, unit="°",
        words="the sun at elevation {value:g}°",
    )  # fmt: skip
    sky: Literal["overcast", "dusk"] | None = _word(
        "sky", "light of the sky", ("clear", "overcast", "dusk"), words="{value} sky",
        more="Clear is the map's own light. With overcast there is hardly any shadow. At dusk the sun has set, and "
        "lamps and windows shine.",
    )  # fmt: skip
    season: Literal["autumn"] | None = _word(
        "season", "season of trees and grass", ("summer", "autumn"), words="{value}",
        more="Summer is the map's own season.",
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Raise UsageError for a sun position that is out of bounds, or combined with dusk."""
        check_bounds(self)
        if self.sky == "dusk" and (self.sun_azimuth_deg is not None or self.sun_elevation_deg is not None):
            raise UsageError("at dusk the sun has set, so it cannot be placed. Leave --sun or --sky dusk out")

    @property
    def of_map(self) -> SceneConditions:
        """These conditions as the type that a world takes."""
        return SceneConditions(**asdict(self))


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbances:
    frame: FrameFaults = FrameFaults()
    link: LinkFaults = LinkFaults()
    vehicle: VehicleFaults = VehicleFaults()
    conditions: FlightConditions = FlightConditions()

    @property
    def words(self) -> str | None:
        """The disturbances in words, joined by commas, for run.json and reports; None without any."""
        parts = words_of(self.frame), self.link.words, words_of(self.vehicle), words_of(self.conditions)
        return ", ".join(chain(*parts)) or None

    def with_options(self, options: Mapping[str, Any], varied: Collection[str] = ()) -> "Disturbances":
        """Return a copy with the values of options. Raises UsageError.

        `options`: name → number or text, None if not set. `varied`: names of the factors that a study sets afterwards.
        """
        values = self._values()
        for part, name, disturbance in DECLARED:
            option = disturbance.option
            if option and (value := options.get(option.name)) is not None:
                values[part] |= option.read(value) if option.read else {name: float(value)}
        if (link := options.get("link")) is not None and "link_baud" not in varied:
            _check_queue(link)
        return _made(values)

    def with_levels(self, levels: Mapping[str, Level]) -> "Disturbances":
        """Return a copy with a study's levels, name → level. Raises UsageError."""
        values = self._values()
        for part, name, level in LEVELS:
            if level.name not in levels:
                continue
            value = levels[level.name]
            if isinstance(level, DisturbanceWord):
                values[part][name] = level.value(value)
            elif level.put:
                level.put(values[part], level.read(value))
            else:
                values[part][name] = value
        return _made(values)

    def level(self, name: str) -> float | None:
        """Return the current number of a factor; None if the factor is unset or a word."""
        part, of, level = next(entry for entry in LEVELS if entry[2].name == name)
        value = getattr(self, part)
        if isinstance(level, DisturbanceLevel) and level.get:
            return level.get(value)
        number = getattr(value, of)
        return float(number) if isinstance(number, int | float) else None

    def _values(self) -> dict[str, FieldValues]:
        return {
            name: {field.name: getattr(getattr(self, name), field.name) for field in fields(of)}
            for name, of in _SECTIONS.items()
        }


UNDISTURBED = Disturbances()
_SECTIONS = {"frame": FrameFaults, "link": LinkFaults, "vehicle": VehicleFaults, "conditions": FlightConditions}
DECLARED: tuple[tuple[str, str, Disturbance], ...] = tuple(  # section, field, declaration
    (part, name, disturbance) for part, of in _SECTIONS.items() for name, disturbance in declarations(of).items()
)
LEVELS = tuple((part, name, level) for part, name, disturbance in DECLARED for level in disturbance.levels)


def _made(values: Mapping[str, FieldValues]) -> Disturbances:
    sections: FieldValues = {name: of(**values[name]) for name, of in _SECTIONS.items()}
    return Disturbances(**sections)
