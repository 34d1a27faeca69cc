"""The panels beside the map: what each pilot saw and said, what each vehicle does, and the judge's view on demand."""

from collections.abc import Callable
from typing import Any

import viser

from dronecats.view.live import markup
from dronecats.view.live.moment import DroneMoment, Moment
from foundation.run_folder.rows import drone_label

NOBODY = "nobody"
WIDTH_PX, FLEET_PX = 400, 520


class FlightPanels:
    """Shows moments of one flight; what it is told twice it sends once."""

    def __init__(
        self,
        server: viser.ViserServer,
        drones: int,
        *,
        piloted: bool = True,
        on_judge: Callable[[bool], None] | None = None,
        on_follow: Callable[[int | None], None] | None = None,
    ) -> None:
        """Lay the panels out, those of pictures and replies only where a pilot is watched.

        `on_judge` and `on_follow` are called when somebody wants the judge's view, or to go with a drone, which each
        browser then sees.
        """
        self._server, self._drones = server, drones
        self._told: dict[str, object] = {}
        self._on_judge = on_judge
        self.judge_shown = False
        gui = server.gui
        self._pictures = gui.add_panel() if piloted else None
        self._frames = self._beside(self._pictures) if self._pictures is not None else None
        self._folder = gui.add_folder("Flight")
        with self._folder:
            self._state = gui.add_html("")
            names = (NOBODY, *(drone_label(k) for k in range(drones)))
            self._follow: Any = gui.add_dropdown("Go with", names, initial_value=NOBODY)
            self._judge: Any = gui.add_checkbox("The judge's view", False)
            self._judged = gui.add_html("")
            self._pilots = gui.add_html("", visible=piloted)
            self._numbers = gui.add_html("")
            self._messages = gui.add_html("")
        if on_follow is not None:
            self._follow.on_update(_by_hand(lambda: on_follow(self._wanted())))
        self._judge.on_update(_by_hand(lambda: self._ask(bool(self._judge.value))))

    def _beside(self, panel: Any) -> Any:
        """Lay the pictures' panel out, and return what shows them."""
        one = self._drones == 1
        self.pictures = panel.add_tab("What the pilot saw" if one else "What the pilots saw", viser.Icon.CAMERA)
        with self.pictures:
            frames = self._server.gui.add_html("")
        panel.dock_left()
        panel.set_width(WIDTH_PX if one else FLEET_PX)
        return frames

    def show(self, moment: Moment) -> None:
        """Bring the panels up to a moment."""
        with self._server.atomic():
            self._write("state", self._state, (markup.clock(moment.t_s), moment.state, moment.instruction),
                        lambda: markup.state_html(moment))  # fmt: skip
            drones = moment.drones[: self._drones]
            if self._frames is not None:
                frames = tuple(_pictured(drone) for drone in drones)
                self._write("frames", self._frames, frames, lambda: markup.frames_html(drones))
                decided = tuple((one.decision and one.decision.step, one.prompt) for one in drones)
                self._write("pilots", self._pilots, decided, lambda: markup.decisions_html(drones))
            self._write("numbers", self._numbers, markup.numbers_html(drones))
            said = tuple(drone.said for drone in moment.drones)
            self._write("messages", self._messages, said, lambda: markup.messages_html(moment.drones))
            judged = markup.judge_html(moment.judge) if self.judge_shown else ""
            self._write("judge", self._judged, judged)
        self._server.flush()

    def forget(self) -> None:
        """Send everything anew with the next moment, which is of another flight."""
        self._told.clear()

    def _wanted(self) -> int | None:
        """Return the drone that the view is to go with."""
        named = {drone_label(k): k for k in range(self._drones)}
        return named.get(self._follow.value)

    def show_wanted(self, judge: bool, followed: int | None) -> None:
        """Have the fields say what is wanted otherwise, by a key: nobody is called back."""
        self.judge_shown = judge
        name = NOBODY if followed is None else drone_label(followed)
        for field, value in ((self._judge, judge), (self._follow, name)):
            if field.value != value:
                field.value = value

    def remove(self) -> None:
        """Take the panels away, for those of another flight."""
        if self._pictures is not None:
            self._pictures.remove()
        self._folder.remove()

    def _ask(self, wanted: bool) -> None:
        self.judge_shown = wanted
        if self._on_judge is not None:
            self._on_judge(wanted)

    def _write(self, name: str, handle: Any, key: object, html: Callable[[], str] | None = None) -> None:
        """Send what a handle shows when its key has changed; without `html` the key is what it shows."""
        if self._told.get(name) != key:
            self._told[name] = key
            handle.content = key if html is None else html()


def _by_hand(act: Callable[[], None]) -> Callable[[Any], None]:
    """Return what takes an event of a browser, and passes over what we have set ourselves."""

    def changed(event: Any) -> None:
        if event.client is not None:
            act()

    return changed


def _pictured(drone: DroneMoment) -> tuple[int | None, int | None]:
    """Return what tells the picture that is shown of a drone from others, and the ring in it."""
    picture, decision = markup.newest_decided(drone)
    return (picture.frame_id if picture else None, decision.step if decision else None)
