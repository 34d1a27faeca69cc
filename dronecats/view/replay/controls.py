"""The controls of a replay: a panel with runs, time, speed, lists of events, and additional views."""

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from typing import Any

import numpy as np
import viser

from dronecats.view.film.lettering import Picture
from dronecats.view.replay.moments import FlightMoments, Occurrence, OccurrenceKind
from dronecats.view.replay.player import SPEEDS, PlaybackClock
from dronecats.view.replay.views import HEIGHT_PX, WIDTH_PX, RedrawnView
from dronecats.view.scene.page import by_user
from foundation.run_folder.rows import drone_label

STEP_S = 0.1  # s of the episode, length of a step
AFTER_END_S = 1e9  # s, later than the end of any flight; the clock stops at the end of the flight
NOT_DRAWN = "not drawn"
NONE = "none"
TIMES: dict[str, tuple[Any, ...]] = {  # button → method of PlaybackClock, and its arguments
    "|◀": (PlaybackClock.scrubbed, 0.0),
    "-0.1": (PlaybackClock.stepped, -STEP_S),
    "▶❚❚": (PlaybackClock.toggled,),
    "+0.1": (PlaybackClock.stepped, STEP_S),
    "▶|": (PlaybackClock.scrubbed, AFTER_END_S),
}
LISTS = {
    OccurrenceKind.DECISION: "Decisions",
    OccurrenceKind.DECLARATION: "Declarations",
    OccurrenceKind.FAULT: "Problems",
}


class Controls:
    """Shows the clock and the runs, and passes the orders of users to the clock."""

    def __init__(
        self,
        server: viser.ViserServer,
        order: Callable[..., None],
        flights: Sequence[FlightMoments],
        shades: Sequence[tuple[int, int, int]],
        end_s: float,
        pictures: Any,
    ) -> None:
        """`order`: see `Player.order`; `shades`: RGB colours of the flights; `pictures`: panel for redrawn views."""
        self._server, self._order, self._flights, self._shades = server, order, flights, shades
        self._chosen: int | None = None  # number of the flight whose occurrences are listed
        self._shown_view: RedrawnView | None = None
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
        self._time.on_update(by_user(lambda: order(PlaybackClock.scrubbed, float(self._time.value))))
        times.on_click(lambda event: order(*TIMES[event.target.value]))
        self._speed.on_update(by_user(lambda: order(PlaybackClock.at_speed, float(self._speed.value[:-1]))))
        for kind, handle in self._lists.items():
            handle.on_update(by_user(partial(self._jump, kind)))

    def on_view(self, chosen: Callable[[RedrawnView | None], None]) -> None:
        """Set the callback for a user's choice of a view."""
        views = {view.value: view for view in RedrawnView}
        self._view.on_update(by_user(lambda: chosen(views.get(self._view.value))))

    def show(self, t_s: float, clock: PlaybackClock) -> None:
        """Show a time of the episode (s) and the state of the clock."""
        state = "▶" if clock.playing else "❚❚"
        speed = _times(clock.speed)
        text = f"{state} {t_s:.1f} s of {clock.end_s:.1f} s · {speed}"
        _write(self._clock, f'<b class="replay-clock">{text}</b>')
        self._time.value = round(t_s, 2)
        if speed not in self._speed.options:
            self._speed.options = (*self._speed.options, speed)
        self._speed.value = speed

    def show_chosen(self, number: int) -> None:
        """Show the chosen flight, and the lists of its occurrences."""
        if self._chosen == number:
            return
        self._chosen = number
        self._runs.content = _runs_html(self._flights, self._shades, number)
        for kind, handle in self._lists.items():
            self._listed[kind] = self._flights[number].of(kind)
            rows = [f"{k}. {_row(o, self._flights[number])}" for k, o in enumerate(self._listed[kind], 1)]
            handle.options = (f"{len(rows)} to jump to" if rows else NONE, *rows)
            handle.value = handle.options[0]

    def show_view(self, view: RedrawnView | None) -> None:
        """Show the name of the chosen view. `show_picture` shows its picture later."""
        if self._shown_view is view:
            return
        self._shown_view = view
        self._view.value = NOT_DRAWN if view is None else view.value
        self._picture.visible = False
        _write(self._caption, "" if view is None else "drawing …")

    def show_picture(self, picture: Picture | str, caption: str) -> None:
        """Show the picture of a view, or a text that says why it cannot be drawn."""
        drawn = not isinstance(picture, str)
        if drawn:
            self._picture.image = picture
        self._picture.visible = drawn
        _write(self._caption, f'<span class="again">{escape(caption if drawn else str(picture))}</span>')

    def show_keys(self, html: str) -> None:
        """Show the list of the keys in a dialog. If the dialog is open, close it."""
        if self._modal is not None:
            self._modal.close()
            self._modal = None
            return
        self._modal = self._server.gui.add_modal("Keys")
        with self._modal:
            self._server.gui.add_html(html)

    def _jump(self, kind: OccurrenceKind) -> None:
        handle, listed = self._lists[kind], self._listed.get(kind, ())
        number = str(handle.value).partition(".")[0]
        if number.isdigit() and int(number) <= len(listed):
            self._order(PlaybackClock.scrubbed, listed[int(number) - 1].t_s)
        handle.value = handle.options[0]  # so that the same entry can be chosen again


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
