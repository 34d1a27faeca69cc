"""The episode editor: the session with its undo history, and the server that shows it."""

import contextlib
import difflib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.view.editor.assessment import Previews, findings
from dronecats.view.editor.draft import Draft, Drafting
from dronecats.view.editor.panels import Panels
from dronecats.view.editor.scene_view import SceneView
from dronecats.view.scene import display
from dronecats.view.scene.page import LoopbackServer
from episodes import maps
from episodes.authoring.check.finding import RuleFinding
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord, parse
from foundation.errors import UsageError
from foundation.files import write_text
from foundation.threads import Latest

MOST_UNDONE = 200


class Session:
    """Holds the drafts. Every method may be called from any thread; `changed` runs after each change, outside the lock.

    While something is dragged only the last of its places is kept for undoing: changes that name the same gesture
    replace one another.
    """

    def __init__(self, drafting: Drafting, first: Draft, folder: Path) -> None:
        """Begin with a draft; records are written into `folder`."""
        self.drafting = drafting
        self.folder = folder
        self.changed: Callable[[Draft, str], None] = lambda draft, gesture: None
        self._past: list[Draft] = []
        self._future: list[Draft] = []
        self._draft = first
        self._gesture = ""
        self._turn = threading.RLock()

    @property
    def draft(self) -> Draft:
        """Return the draft of now."""
        return self._draft

    @property
    def record(self) -> EpisodeRecord:
        """Return its record."""
        return self._draft.record

    def do(self, operation: Callable[[Draft], Draft], gesture: str = "") -> None:
        """Apply an operation to the draft. Raises what it raises, and then nothing has changed."""
        with self._turn:
            following = operation(self._draft)
            if following == self._draft:
                return
            if not gesture or gesture != self._gesture:
                self._past = [*self._past[-MOST_UNDONE + 1 :], self._draft]
            self._draft, self._gesture, self._future = following, gesture, []
        self.changed(following, gesture)

    def settle(self) -> None:
        """End a gesture, so that the next one can be undone on its own."""
        self._gesture = ""
        self.changed(self._draft, "")

    def undo(self) -> bool:
        """Go back by one step; return whether there was one."""
        return self._step(self._past, self._future)

    def redo(self) -> bool:
        """Take back an undoing; return whether there was one."""
        return self._step(self._future, self._past)

    def _step(self, source: list[Draft], other: list[Draft]) -> bool:
        with self._turn:
            if not source:
                return False
            other.append(self._draft)
            self._draft, self._gesture = source.pop(), ""
        self.changed(self._draft, "")
        return True

    def path(self) -> Path:
        """Return the file that `save` would write."""
        return self.folder / f"{self.record.id}.json"

    def save(self, replace: bool = False) -> Path:
        """Write the record and return its file. The folder was chosen where the editor was started; its name is its id.

        Raises UsageError for a record that could not be read back, for the id of an episode that ships, unless it is
        that very file and `replace`, and for a file that exists unless `replace`.
        """
        record = self.record
        text = record.to_json()
        parse(text, f"episode '{record.id[:64]}'")  # the id is a plain name from here on
        path = self.path()
        if record.id in catalogue.all_ids() and path.resolve() != (catalogue.FOLDER / path.name).resolve():
            raise UsageError(f"'{record.id}' is the id of an episode that ships: give yours another one.")
        if path.exists() and not replace:
            raise UsageError(f"'{path}' exists already: give the episode another id, or replace the file.")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_text(path, text)
        except OSError as error:
            raise UsageError(f"'{path}' cannot be written: {error.strerror}.") from None
        return path


@dataclass(frozen=True, slots=True)
class _Sight:
    record: EpisodeRecord
    drone: int


class Editor:
    """One person at work on one episode. `url` is where."""

    def __init__(self, what: str, folder: Path, port: int, hosts: Sequence[str] = ()) -> None:
        """Open a map by its name, or an episode by its id or file, and serve the page. Raises UsageError.

        `hosts` as `LoopbackServer` has them.
        """
        session, scene_name = opened(what, folder)
        self.session = session
        self.drafting = session.drafting
        self.findings: tuple[RuleFinding, ...] = ()  # of the newest record that was checked
        self.checked: EpisodeRecord | None = None
        self._server = LoopbackServer(f"DroneCATS · {scene_name}", port, hosts)
        self.url = self._server.url
        self._showing = threading.RLock()
        self._picker = display.Picker(self.drafting.scene)
        self._previews = Previews()
        self._panels = Panels(self._server, self, f"DroneCATS · {scene_name}")
        self._view = SceneView(self._server, self.drafting, self)
        self._view.frame(session.draft)
        self._pictures = Latest(self._draw, "editor-picture")
        self._checks = Latest(self._check, "editor-checks")
        session.changed = self._changed
        self._server.scene.on_click()(self._clicked)
        self._changed(session.draft, "")

    def idle(self, timeout_s: float) -> bool:
        """Wait until picture and checks are those of the draft of now; return whether they are."""
        return self._pictures.idle(timeout_s) and self._checks.idle(timeout_s)

    def close(self) -> None:
        """End the threads and the server."""
        self._pictures.close()
        self._checks.close()
        self._previews.close()
        self._server.stop()

    # ---- orders of the panels

    def do(self, operation: Callable[[Draft], Draft], client: Any) -> None:
        """Change the draft, or tell the client why not."""
        try:
            self.session.do(operation)
        except UsageError as error:
            self._refuse(client, error)

    def save(self, replace: bool, client: Any) -> None:
        """Write the record."""
        try:
            path = self.session.save(replace)
        except UsageError as error:
            self._panels.tell(str(error), replaceable="replace the file" in str(error))
            self._refuse(client, error)
            return
        red = sum(not f.passed for f in self.findings)
        self._panels.tell(f"Written: {path}" + (f" ({red} checks are red)" if red else ""))

    def undo(self) -> None:
        """Go back."""
        self.session.undo()

    def redo(self) -> None:
        """Go forward."""
        self.session.redo()

    def select(self, drone: int) -> None:
        """Look through another drone's camera."""
        self._panels.show(self.session.draft)
        self._pictures.put(_Sight(self.session.record, drone))

    # ---- hands on the scene

    def moved(self, thing: str, north: float, east: float, yaw_deg: float) -> None:
        """Move what is being dragged."""
        kind, _, number = thing.partition("-")
        which = int(number or 0)
        operations: dict[str, Callable[[Draft], Draft]] = {
            "target": lambda d: self.drafting.move_target(d, north, east, yaw_deg),
            "waypoint": lambda d: self.drafting.move_waypoint(d, which, north, east),
            "drone": lambda d: self.drafting.move_start(d, which, north, east, yaw_deg),
            "candidate": lambda d: self.drafting.move_candidate(d, which - 1, north, east, yaw_deg),
        }
        with contextlib.suppress(UsageError, IndexError):  # gone, or at an end, while it was in the hand
            self.session.do(operations[kind], gesture=thing)

    def let_go(self) -> None:
        """The drag is over: everything snaps to where it is."""
        self.session.settle()

    def _clicked(self, event: Any) -> None:
        """Do with a click on the map what the panel says that a click does."""
        meaning = self._panels.click
        if not meaning:
            return
        hit = self._picker.pick(display.ned_of(event.ray_origin), display.ned_of(event.ray_direction))
        if hit is None:
            return
        (north, east, _), thing = hit
        operations: dict[str, Callable[[Draft], Draft]] = {
            "target": lambda d: self.drafting.move_target(d, north, east),
            "waypoint": lambda d: self.drafting.add_waypoint(d, north, east),
            "drone": lambda d: self.drafting.move_start(d, self._panels.drone, north, east),
            "candidate": lambda d: self.drafting.add_candidate(d, north, east),
            "native": lambda d: self.drafting.adopt(d, thing.name),
        }
        self.do(operations[meaning], event.client)

    # ---- what follows from a change

    def _changed(self, draft: Draft, gesture: str) -> None:
        """Show the draft of now, which may be a later one than `draft`: changes come from several threads."""
        with self._showing:
            now = self.session.draft
            self._view.show(now)
            self._panels.show(now)
            self._panels.show_checks(self.findings, fresh=self.checked == now.record)
            if not gesture:
                self._panels.tell("")
            self._pictures.put(_Sight(now.record, self._panels.drone))
            self._checks.put(now.record)

    def _draw(self, sight: _Sight) -> None:
        drone = min(sight.drone, len(sight.record.starts) - 1)
        with contextlib.suppress(UsageError):  # the checks say what is wrong with the record
            picture = self._previews.picture(sight.record, drone)
            self._panels.show_picture(picture)
            self._view.show_view(drone, picture)

    def _check(self, record: EpisodeRecord) -> None:
        found = tuple(findings(record))
        self.findings, self.checked = found, record
        self._panels.show_checks(found, fresh=record == self.session.record)

    @staticmethod
    def _refuse(client: Any, error: UsageError) -> None:
        if client is not None:
            client.add_notification("That cannot be done", str(error), auto_close_seconds=8.0, color="red")


def opened(what: str, folder: Path) -> tuple[Session, str]:
    """Return a session on a map's name, or on an episode's id or file, and what it is called. Raises UsageError."""
    if what in maps.names():
        drafting = Drafting(maps.build(what))
        return Session(drafting, drafting.new(what), folder), what
    try:
        catalogue.must_exist(what)
    except UsageError:
        names = [*maps.names(), *catalogue.all_ids()]
        near = ", ".join(difflib.get_close_matches(what[:100], names, 3) or maps.names())
        raise UsageError(f"{what[:80]!r} is no map, no episode and no record file: did you mean {near}?") from None
    record = catalogue.load(what)
    drafting = Drafting(maps.build(record.map, record.map_seed))
    return Session(drafting, drafting.opened(record), folder), record.id
