"""The page of `dronecats replay`: shows flights of one episode in the browser, all at the same time of the episode."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from typing import Any, cast

from dronecats.report.kit import palette
from dronecats.view.film.lettering import Picture
from dronecats.view.live.panels import FlightPanels
from dronecats.view.live.scene import COLORS, FlightScene
from dronecats.view.replay.controls import AFTER_END_S, STEP_S, Controls
from dronecats.view.replay.moments import FlightMoments, OccurrenceKind, check_same_episode, neighbour
from dronecats.view.replay.player import PlaybackClock, Player
from dronecats.view.replay.views import RedrawnView, ViewRenderer, ViewRequest
from dronecats.view.scene.page import LoopbackServer, by_user
from foundation.errors import UsageError
from foundation.run_folder.rows import drone_label

RUN_COLORS = (*COLORS, palette.linear(palette.LIGHT["ink"]))  # linear RGB, one colour per overlaid flight
TRAIL_S = 0.1  # s between two positions of a replaced trail
CHOICES = 9  # the digits 1 to 9 can choose at most this many runs or drones
GAP_S = 1.0  # s, longest time step that extends a trail; a longer step replaces the trail
VIEWS: tuple[RedrawnView | None, ...] = (None, *RedrawnView)


@dataclass(frozen=True, slots=True)
class PageState:
    """The choices of the users of the page."""

    flight: int = 0
    drone: int = 0
    along: bool = False  # whether the view follows `drone`
    judge: bool = False  # whether the judge's data (target, distances) are shown
    view: RedrawnView | None = None


class ReplayPage:
    """Shows flights of one episode in the browser; the page is at `url`."""

    def __init__(
        self,
        flights: Sequence[FlightMoments],
        port: int,
        speed: float = 1.0,
        at_s: float = 0.0,
        hosts: Sequence[str] = (),
    ) -> None:
        """Serve the page, paused at `at_s`; `hosts`: see `LoopbackServer`.

        Raises UsageError for too many flights, and for flights of different episodes.
        """
        if len(flights) > CHOICES:
            raise UsageError(f"{len(flights)} runs are too many for one page. Choose {CHOICES} at most")
        check_same_episode(flights)
        self.flights = tuple(flights)
        clock = PlaybackClock(max(flight.end_s for flight in flights)).at_speed(speed, 0.0)
        self._server = LoopbackServer(f"DroneCATS · {flights[0].recorded.id}", port, hosts)
        self.url = self._server.url
        self._server.gui.set_panel_label(f"DroneCATS · {flights[0].recorded.id}")
        self._turn = threading.Lock()
        self._state = PageState()
        self._applied: PageState | None = None
        self._shown_s: float | None = None
        self._requested: ViewRequest | None = None
        several = len(flights) > 1
        drones = max(len(flight.drones) for flight in flights)
        colors = [(RUN_COLORS[k],) * len(f.drones) if several else COLORS for k, f in enumerate(flights)]
        self._panels = FlightPanels(self._server, drones, on_judge=self.judge, on_follow=self._followed)
        self._server.gui.main_panel.dock_right()
        shades = [palette.shade(own[0]) for own in colors]
        self._controls = Controls(self._server, self.order, flights, shades, clock.end_s, self._panels.pictures)
        self._scenes = [
            FlightScene(
                self._server,
                flight.world.scene if flight.world else None,
                drones=max(flight.drones) + 1,
                name=f"{k + 1} {flight.recorded.folder.resolve().parent.name}" if several else "",
                colors=own,
                camera=flight.recorded.camera,
            )
            for k, (flight, own) in enumerate(zip(flights, colors, strict=True))
        ]
        self._views = ViewRenderer([flight.recorded if flight.world else None for flight in flights], self._drawn)
        self._controls.on_view(lambda view: self._choose(lambda state: replace(state, view=view)))
        self._choices = "run" if several else "drone" if drones > 1 else ""
        self._bind(len(flights) if several else drones if drones > 1 else 0)
        self._player = Player(clock.scrubbed(at_s, 0.0), self._show)

    @property
    def t_s(self) -> float:
        """The current time of the episode, s."""
        return self._player.t_s

    @property
    def clock(self) -> PlaybackClock:
        return self._player.clock

    @property
    def state(self) -> PageState:
        with self._turn:
            return self._state

    def idle(self, timeout_s: float) -> bool:
        """Wait until the clock has stopped and everything is sent; return False after the timeout."""
        return self._player.idle(timeout_s) and self._views.idle(timeout_s)

    def close(self) -> None:
        self._player.close()
        self._views.close()
        self._server.stop()

    # ---- orders of keys, buttons and lists

    def order(self, method: Callable[..., PlaybackClock], *arguments: float) -> None:
        """Change the clock; see `Player.order`."""
        self._player.order(method, *arguments)

    def jump(self, kind: OccurrenceKind, ahead: bool) -> None:
        """Go to the next (`ahead`) or previous occurrence of a kind in the chosen flight, if there is one."""
        listed = self.flights[self.state.flight].of(kind)

        def there(clock: PlaybackClock, wall_s: float) -> PlaybackClock:
            occurrence = neighbour(listed, clock.at(wall_s), ahead)
            return clock if occurrence is None else clock.scrubbed(occurrence.t_s, wall_s)

        self.order(there)

    def choose(self, number: int) -> None:
        """Choose a run, or a drone if there is only one run; 0 is the first."""
        if len(self.flights) > 1:
            self._choose(lambda state: replace(state, flight=number))
        else:
            self._choose(lambda state: replace(state, drone=number))

    def go_along(self) -> None:
        """Start or stop following the chosen drone."""
        self._choose(lambda state: replace(state, along=not state.along))

    def judge(self, shown: bool | None = None) -> None:
        """Show or hide the judge's view; None: change it."""
        self._choose(lambda state: replace(state, judge=not state.judge if shown is None else shown))

    def next_view(self) -> None:
        """Choose the next redrawn view; after the last view, no view."""
        self._choose(lambda state: replace(state, view=VIEWS[(VIEWS.index(state.view) + 1) % len(VIEWS)]))

    def help(self) -> None:
        """Show or hide the keys."""
        self._controls.show_keys(keys_html(self._choices))

    def _bind(self, choices: int) -> None:
        """Bind every key; `choices`: number of digit keys."""
        digits = [str(number) for number in range(1, min(choices, CHOICES) + 1)]
        chosen = [KeyBinding(key, ((key, None),), f"choose {key}", partial(ReplayPage.choose, number=k))
                  for k, key in enumerate(digits)]  # fmt: skip
        for binding in (*KEYS, *chosen):
            for key, held in binding.keys:
                label = binding.does[0].upper() + binding.does[1:]
                command = self._server.gui.add_command(label, hotkey=cast(Any, key), modifier=cast(Any, held))
                command.on_trigger(by_user(partial(binding.order, self)))

    def _followed(self, drone: int | None) -> None:
        self._choose(
            lambda state: replace(state, along=drone is not None, drone=state.drone if drone is None else drone)
        )

    def _choose(self, change: Callable[[PageState], PageState]) -> None:
        with self._turn:
            before, self._state = self._state, change(self._state)
            if self._state == before:
                return
        self._player.again()

    # ---- updates in the player's thread

    def _show(self, t_s: float, clock: PlaybackClock) -> None:
        state = self.state
        self._apply(state)
        jumped = self._shown_s is None or not 0.0 <= t_s - self._shown_s <= GAP_S
        numbers = sorted(range(len(self.flights)), key=lambda number: number == state.flight)
        for number in numbers:  # the chosen flight last: it sets the initial view of new browsers
            flight, scene = self.flights[number], self._scenes[number]
            moment = flight.moment(t_s)
            if jumped:
                for drone in flight.drones:
                    scene.show_trail(drone, flight.way(drone, moment.t_s, TRAIL_S))
            scene.show(moment)
            if number == state.flight:
                self._panels.show(moment)
        self._controls.show(t_s, clock)
        self._shown_s = t_s
        self._request_view(state, t_s)
        self._server.flush()

    def _apply(self, state: PageState) -> None:
        """Apply the choices to scenes and panels."""
        before, self._applied = self._applied, state
        self._controls.show_chosen(state.flight)
        self._controls.show_view(state.view)
        self._panels.show_wanted(state.judge, self._drone(state) if state.along else None)
        for number, scene in enumerate(self._scenes):
            # only the chosen flight shows objects: a flight that is already over would show its target at an old place
            scene.shows_objects = number == state.flight
            scene.judge_shown = state.judge and number == state.flight
            if before is None or replace(before, judge=state.judge, view=state.view) != state:
                scene.follow(self._drone(state) if state.along and number == state.flight else None)

    def _drone(self, state: PageState) -> int:
        """Return the chosen drone, or the first drone if the chosen flight does not have it."""
        drones = self.flights[state.flight].drones
        return state.drone if state.drone in drones else drones[0]

    def _request_view(self, state: PageState, t_s: float) -> None:
        if state.view is None:
            self._requested = None
            return
        request = ViewRequest(state.flight, self._drone(state), state.view, min(t_s, self.flights[state.flight].end_s))
        if request != self._requested:
            self._requested = request
            self._views.put(request)

    def _drawn(self, request: ViewRequest, picture: Picture | str) -> None:
        state = self.state
        if (request.flight, request.view) == (state.flight, state.view):
            drone = f"{drone_label(request.drone)} " if len(self.flights[request.flight].drones) > 1 else ""
            self._controls.show_picture(picture, f"{drone}{request.view.value} at {request.t_s:.1f} s")
            self._server.flush()


@dataclass(frozen=True, slots=True)
class KeyBinding:
    """A key of the keyboard and the order that it gives."""

    shown: str  # name of the key in the help
    keys: tuple[tuple[str, str | None], ...]  # (the browser's name of the key, modifier)
    does: str  # effect of the key, for the help
    order: Callable[[ReplayPage], None]


DECISION, DECLARATION, FAULT = OccurrenceKind.DECISION, OccurrenceKind.DECLARATION, OccurrenceKind.FAULT
KEYS: tuple[KeyBinding, ...] = (
    KeyBinding("Space", (("space", None),), "play or pause", lambda p: p.order(PlaybackClock.toggled)),
    KeyBinding("→", (("arrowright", None),), "next decision", lambda p: p.jump(DECISION, True)),
    KeyBinding("←", (("arrowleft", None),), "previous decision", lambda p: p.jump(DECISION, False)),
    KeyBinding("Shift →", (("arrowright", "shift"),), "0.1 s later", lambda p: p.order(PlaybackClock.stepped, STEP_S)),
    KeyBinding("Shift ←", (("arrowleft", "shift"),), "0.1 s earlier",
               lambda p: p.order(PlaybackClock.stepped, -STEP_S)),
    KeyBinding("Home", (("home", None),), "beginning", lambda p: p.order(PlaybackClock.scrubbed, 0.0)),
    KeyBinding("End", (("end", None),), "end", lambda p: p.order(PlaybackClock.scrubbed, AFTER_END_S)),
    KeyBinding("+", (("[plus]", None), ("[plus]", "shift"), ("=", None)), "faster",
               lambda p: p.order(PlaybackClock.faster)),
    KeyBinding("-", (("-", None),), "slower", lambda p: p.order(PlaybackClock.slower)),
    KeyBinding("D", (("D", None),), "next declaration", lambda p: p.jump(DECLARATION, True)),
    KeyBinding("Shift D", (("D", "shift"),), "previous declaration", lambda p: p.jump(DECLARATION, False)),
    KeyBinding("F", (("F", None),), "next problem", lambda p: p.jump(FAULT, True)),
    KeyBinding("Shift F", (("F", "shift"),), "previous problem", lambda p: p.jump(FAULT, False)),
    KeyBinding("V", (("V", None),), "draw this moment: from behind, from above, through the camera, or off",
               ReplayPage.next_view),
    KeyBinding("G", (("G", None),), "follow the chosen drone, or stop following", ReplayPage.go_along),
    KeyBinding("J", (("J", None),), "show or hide the judge's view", ReplayPage.judge),
    KeyBinding("?", (("?", "shift"), ("?", None)), "these keys", ReplayPage.help),
)  # fmt: skip


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
