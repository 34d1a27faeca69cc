"""The controls of a replay: keys, and a panel with runs, time, speed, lists of events, and additional views."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from typing import Any, Protocol, cast

import numpy as np
import viser

from dronecats.view.film.lettering import Picture
from dronecats.view.replay.moments import FlightMoments, Occurrence, OccurrenceKind
from dronecats.view.replay.player import SPEEDS, PlaybackClock
from dronecats.view.replay.views import HEIGHT_PX, WIDTH_PX, RedrawnView
from foundation.run_folder.rows import drone_label

STEP_S = 0.1  # s of the episode, length of a step
CHOICES = 9  # the digits 1 to 9 can choose at most this many runs or drones


class ReplayOrders(Protocol):
    """The methods that keys, buttons and lists call. `ReplayPage` implements and documents them."""

    def toggle(self) -> None: ...

    def step(self, by_s: float) -> None: ...

    def go_to(self, t_s: float) -> None: ...

    def jump(self, kind: OccurrenceKind, ahead: bool) -> None: ...

    def faster(self) -> None: ...

    def slower(self) -> None: ...

    def at_speed(self, speed: float) -> None: ...

    def choose(self, number: int) -> None: ...

    def go_along(self) -> None: ...

    def judge(self) -> None: ...

    def next_view(self) -> None: ...

    def help(self) -> None: ...


@dataclass(frozen=True, slots=True)
class KeyBinding:
    """A key of the keyboard and the order that it gives."""

    shown: str  # name of the key in the help
    keys: tuple[tuple[str, str | None], ...]  # (the browser's name of the key, modifier)
    does: str  # effect of the key, for the help
    order: Callable[[ReplayOrders], None]


AFTER_END_S = 1e9  # s, later than the end of any flight; the clock stops at the end of the flight
DECISION, DECLARATION, FAULT = OccurrenceKind.DECISION, OccurrenceKind.DECLARATION, OccurrenceKind.FAULT
KEYS: tuple[KeyBinding, ...] = (
    KeyBinding("Space", (("space", None),), "play or pause", lambda o: o.toggle()),
    KeyBinding("→", (("arrowright", None),), "next decision", lambda o: o.jump(DECISION, True)),
    KeyBinding("←", (("arrowleft", None),), "previous decision", lambda o: o.jump(DECISION, False)),
    KeyBinding("Shift →", (("arrowright", "shift"),), "0.1 s later", lambda o: o.step(STEP_S)),
    KeyBinding("Shift ←", (("arrowleft", "shift"),), "0.1 s earlier", lambda o: o.step(-STEP_S)),
    KeyBinding("Home", (("home", None),), "beginning", lambda o: o.go_to(0.0)),
    KeyBinding("End", (("end", None),), "end", lambda o: o.go_to(AFTER_END_S)),
    KeyBinding("+", (("[plus]", None), ("[plus]", "shift"), ("=", None)), "faster", lambda o: o.faster()),
    KeyBinding("-", (("-", None),), "slower", lambda o: o.slower()),
    KeyBinding("D", (("D", None),), "next declaration", lambda o: o.jump(DECLARATION, True)),
    KeyBinding("Shift D", (("D", "shift"),), "previous declaration", lambda o: o.jump(DECLARATION, False)),
    KeyBinding("F", (("F", None),), "next problem", lambda o: o.jump(FAULT, True)),
    KeyBinding("Shift F", (("F", "shift"),), "previous problem", lambda o: o.jump(FAULT, False)),
    KeyBinding("V", (("V", None),), "draw this moment: from behind, from above, through the camera, or off",
               lambda o: o.next_view()),
    KeyBinding("G", (("G", None),), "follow the chosen drone, or stop following", lambda o: o.go_along()),
    KeyBinding("J", (("J", None),), "show or hide the judge's view", lambda o: o.judge()),
    KeyBinding("?", (("?", "shift"), ("?", None)), "these keys", lambda o: o.help()),
)  # fmt: skip


def digit(number: int) -> KeyBinding:
    """Return the binding of a digit key, 1 … 9; `number` is 0 … 8."""
    key = str(number + 1)
    return KeyBinding(key, ((key, None),), f"choose {key}", lambda o: o.choose(number))


def bind(server: viser.ViserServer, orders: ReplayOrders, choices: int) -> None:
    """Bind every key to `orders`; `choices`: number of digit keys."""
    for binding in (*KEYS, *(digit(number) for number in range(min(choices, CHOICES)))):
        for key, held in binding.keys:
            label = binding.does[0].upper() + binding.does[1:]
            command = server.gui.add_command(label, hotkey=cast(Any, key), modifier=cast(Any, held))
            command.on_trigger(_in_turn(binding, orders))


def _in_turn(binding: KeyBinding, orders: ReplayOrders) -> Callable[[Any], Any]:
    async def pressed(_: Any) -> None:  # async: viser then calls it in the order of the events
        binding.order(orders)

    return pressed


def keys_html(choices: str) -> str:
    """Return the list of the keys as HTML; `choices`: the items that digits choose ("run", "drone"), or ""."""
    rows = [(binding.shown, binding.does) for binding in KEYS]
    if choices:
        rows.insert(-1, ("1 … 9", f"choose a {choices}"))
    cells = "".join(
        f'<tr><td style="padding:1px 14px 1px 0"><b>{escape(key)}</b></td><td>{escape(does)}</td></tr>'
        for key, does in rows
    )
    return f'<table class="keys" style="font-size:13px;line-height:1.5">{cells}</table>'


NOT_DRAWN = "not drawn"
NONE = "none"
TIMES: dict[str, Callable[[ReplayOrders], None]] = {
    "|◀": lambda orders: orders.go_to(0.0),
    "-0.1": lambda orders: orders.step(-STEP_S),
    "▶❚❚": lambda orders: orders.toggle(),
    "+0.1": lambda orders: orders.step(STEP_S),
    "▶|": lambda orders: orders.go_to(AFTER_END_S),
}
LISTS = {
    OccurrenceKind.DECISION: "Decisions",
    OccurrenceKind.DECLARATION: "Declarations",
    OccurrenceKind.FAULT: "Problems",
}


class Controls:
    """Shows the clock and the runs, and calls ReplayOrders when a user acts."""

    def __init__(
        self,
        server: viser.ViserServer,
        orders: ReplayOrders,
        flights: Sequence[FlightMoments],
        shades: Sequence[tuple[int, int, int]],
        end_s: float,
        pictures: Any,
    ) -> None:
        """`shades`: RGB colours of the flights; `pictures`: the panel for redrawn views."""
        self._server, self._orders, self._flights, self._shades = server, orders, flights, shades
        self._shown: dict[str, object] = {}
        self._listed: dict[OccurrenceKind, tuple[Occurrence, ...]] = {}
        self._modal: Any = None
        gui = server.gui
        with gui.add_folder("Replay", order=-1.0):
            self._runs = gui.add_html("")
            self._clock = gui.add_html("")
            self._time: Any = gui.add_slider("Time", 0.0, max(end_s, 0.01), 0.01, 0.0)
            times: Any = gui.add_button_group("", tuple(TIMES))
            self._speed: Any = gui.add_dropdown("Speed", tuple(_times(s) for s in SPEEDS), initial_value=_times(1.0))
            self._lists: dict[OccurrenceKind, Any] = {
                kind: gui.add_dropdown(title, (NONE,)) for kind, title in LISTS.items()
            }
        with pictures, gui.add_folder("Additional view", order=-1.0):
            names = (NOT_DRAWN, *(view.value for view in RedrawnView))
            self._view: Any = gui.add_dropdown("View", names, initial_value=NOT_DRAWN)
            blank = np.full((HEIGHT_PX, WIDTH_PX, 3), 40, np.uint8)
            self._picture: Any = gui.add_image(blank, format="jpeg", jpeg_quality=85, visible=False)
            self._caption = gui.add_html("")
        self._time.on_update(self._by_hand(lambda: orders.go_to(float(self._time.value))))
        times.on_click(lambda event: TIMES[event.target.value](orders))
        self._speed.on_update(self._by_hand(lambda: orders.at_speed(float(self._speed.value[:-1]))))
        for kind, handle in self._lists.items():
            handle.on_update(self._by_hand(partial(self._jump, kind)))

    def on_view(self, chosen: Callable[[RedrawnView | None], None]) -> None:
        """Set the callback for a user's choice of a view."""
        views = {view.value: view for view in RedrawnView}
        self._view.on_update(self._by_hand(lambda: chosen(views.get(self._view.value))))

    def show(self, t_s: float, clock: PlaybackClock) -> None:
        """Show a time of the episode (s) and the state of the clock."""
        state = "▶" if clock.playing else "❚❚"
        text = f"{state} {t_s:.1f} s of {clock.end_s:.1f} s · {_times(clock.speed)}"
        self._set("clock", text, lambda: _write(self._clock, f'<b class="replay-clock">{text}</b>'))
        self._set("time", round(t_s, 2), lambda: setattr(self._time, "value", round(t_s, 2)))
        self._set("speed", clock.speed, lambda: self._show_speed(clock.speed))

    def show_chosen(self, number: int) -> None:
        """Show the chosen flight, and the lists of its occurrences."""
        if self._shown.get("chosen") == number:
            return
        self._shown["chosen"] = number
        self._runs.content = _runs_html(self._flights, self._shades, number)
        for kind, handle in self._lists.items():
            self._listed[kind] = self._flights[number].of(kind)
            rows = [f"{k}. {_row(o, self._flights[number])}" for k, o in enumerate(self._listed[kind], 1)]
            handle.options = (f"{len(rows)} to jump to" if rows else NONE, *rows)
            handle.value = handle.options[0]

    def show_view(self, view: RedrawnView | None) -> None:
        """Show the name of the chosen view. `show_picture` shows its picture later."""
        name = NOT_DRAWN if view is None else view.value
        if self._shown.get("view") == name:
            return
        self._shown["view"] = name
        self._view.value = name
        self._picture.visible = False
        _write(self._caption, "" if view is None else "drawing …")

    def show_picture(self, picture: Picture | str, caption: str) -> None:
        """Show the picture of a view, or a text that says why it cannot be drawn."""
        drawn = not isinstance(picture, str)
        if drawn:
            self._picture.image = picture
        self._picture.visible = drawn
        _write(self._caption, f'<span class="again">{escape(caption if drawn else str(picture))}</span>')

    def show_keys(self, choices: str) -> None:
        """Show the keys in a dialog. If the dialog is open, close it."""
        if self._modal is not None:
            self._modal.close()
            self._modal = None
            return
        self._modal = self._server.gui.add_modal("Keys")
        with self._modal:
            self._server.gui.add_html(keys_html(choices))

    def _jump(self, kind: OccurrenceKind) -> None:
        handle, listed = self._lists[kind], self._listed.get(kind, ())
        number = str(handle.value).partition(".")[0]
        if number.isdigit() and int(number) <= len(listed):
            self._orders.go_to(listed[int(number) - 1].t_s)
        handle.value = handle.options[0]  # so that the same entry can be chosen again

    def _show_speed(self, speed: float) -> None:
        if _times(speed) not in self._speed.options:
            self._speed.options = (*self._speed.options, _times(speed))
        self._speed.value = _times(speed)

    def _set(self, name: str, value: object, show: Callable[[], None]) -> None:
        if self._shown.get(name) != value:
            self._shown[name] = value
            show()

    @staticmethod
    def _by_hand(act: Callable[[], None]) -> Callable[[Any], Any]:
        """Return a callback that calls `act` for events from browsers and ignores updates by the program."""

        async def changed(event: Any) -> None:  # async: viser then calls it in the order of the events
            if event.client is not None:
                act()

        return changed


def _runs_html(flights: Sequence[FlightMoments], shades: Sequence[tuple[int, int, int]], chosen: int) -> str:
    rows = []
    for number, (flight, shade) in enumerate(zip(flights, shades, strict=True)):
        several, name = len(flights) > 1, escape(flight.recorded.folder.resolve().parent.name)
        dot = f'<span style="color:rgb{shade}">⬤</span> <b>{number + 1}</b> ' if several else ""
        bold = "font-weight:600" if several and number == chosen else ""
        lacks = "".join(f'<div class="missing" style="opacity:0.65">{escape(note)}</div>' for note in flight.missing)
        rows.append(f'<div class="who" style="{bold}">{dot}{name}: {escape(flight.recorded.run.title)}</div>{lacks}')
    title = f'<div style="opacity:0.65">{escape(flights[0].recorded.id)}</div>'
    hint = '<div style="opacity:0.65">? shows the keys</div>'
    return f'<div style="font-size:12px;line-height:1.5;padding:2px 10px 4px">{title}{"".join(rows)}{hint}</div>'


def _row(occurrence: Occurrence, flight: FlightMoments) -> str:
    drone = occurrence.drone
    name = f"{drone_label(drone)}: " if drone is not None and len(flight.drones) > 1 else ""
    return f"{occurrence.t_s:.1f} s  {name}{occurrence.words}"


def _write(handle: Any, html: str) -> None:
    handle.content = f'<div style="font-size:12px;padding:2px 10px">{html}</div>'


def _times(speed: float) -> str:
    return f"{speed:g}×"
