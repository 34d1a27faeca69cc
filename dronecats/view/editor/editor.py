"""The episode editor: a session with an undo history, and the server of the editor's page."""

import contextlib
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dronecats.view.editor.assessment import Previews, findings
from dronecats.view.editor.draft import Draft, Drafting, DraftOperation
from dronecats.view.editor.panels import Panels
from dronecats.view.editor.scene_view import SceneView
from dronecats.view.scene import display
from dronecats.view.scene.page import LoopbackServer
from episodes import maps
from episodes.authoring.check.finding import RuleFinding
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord, parse
from foundation.errors import UsageError
from foundation.files import file_errors_as, write_text
from foundation.threads import NewestItemWorker
from foundation.wording import did_you_mean, nearest

MOST_UNDONE = 200  # the undo history has at most this many steps


class Session:
    """The draft, its undo history, and the file of the record. All methods may be called from any thread.

    `changed(draft, gesture)` runs after each change, outside the lock. A gesture is the name of the dragged object;
    "" without a drag. Changes in a drag are one step of the history, so undo reverts the complete drag.
    """

    def __init__(self, drafting: Drafting, first: Draft, folder: Path) -> None:
        """`first`: the first draft; `folder`: the folder for the records."""
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
        return self._draft

    @property
    def record(self) -> EpisodeRecord:
        return self._draft.record

    def do(self, operation: DraftOperation, gesture: str = "") -> None:
        """Apply an operation to the draft. If the operation raises an exception, nothing changes."""
        with self._turn:
            following = operation(self._draft)
            if following == self._draft:
                return
            if not gesture or gesture != self._gesture:
                self._past = [*self._past[-MOST_UNDONE + 1 :], self._draft]
            self._draft, self._gesture, self._future = following, gesture, []
        self.changed(following, gesture)

    def settle(self) -> None:
        """End a drag, so that the next change is a new step."""
        with self._turn:
            self._gesture = ""
        self.changed(self._draft, "")

    def undo(self) -> bool:
        """Undo the last step; return whether there was one."""
        return self._step(self._past, self._future)

    def redo(self) -> bool:
        """Redo the step that was undone last; return whether there was one."""
        return self._step(self._future, self._past)

    def _step(self, source: list[Draft], opposite: list[Draft]) -> bool:
        with self._turn:
            if not source:
                return False
            opposite.append(self._draft)
            self._draft, self._gesture = source.pop(), ""
        self.changed(self._draft, "")
        return True

    def save(self, replace: bool = False) -> Path:
        """Write the record as ID.json into the session's folder, and return the file.

        Raises UsageError for an invalid record, for the id of a shipped episode (except in the catalogue's own folder),
        and for an existing file unless `replace`.
        """
        record = self.record
        text = record.to_json()
        parse(text, f"episode '{record.id[:64]}'")  # rejects an id that is not a plain file name
        path = self.folder / f"{record.id}.json"
        if record.id in catalogue.all_ids() and path.resolve() != (catalogue.FOLDER / path.name).resolve():
            raise UsageError(f"'{record.id}' is the id of a shipped episode. Choose another id.")
        if path.exists() and not replace:
            raise UsageError(f"'{path}' exists already. Give the episode another id, or replace the file.")
        with file_errors_as(UsageError, f"'{path}' cannot be written", "."):
            self.folder.mkdir(parents=True, exist_ok=True)
            write_text(path, text)
        return path


class Editor:
    """The editor of one episode; its page is at `url`."""

    def __init__(self, name: str, folder: Path, port: int, hosts: Sequence[str] = ()) -> None:
        """Open a map by name, or an episode by id or file, and serve the page. Raises UsageError.

        `hosts`: see `LoopbackServer`.
        """
        session, scene_name = open_session(name, folder)
        self.session = session
        self.drafting = session.drafting
        self.findings: tuple[RuleFinding, ...] = ()  # what the checks found in `self.checked`
        self.checked: EpisodeRecord | None = None
        self._server = LoopbackServer(f"DroneCATS · {scene_name}", port, hosts)
        self.url = self._server.url
        self._showing = threading.RLock()
        self._picker = display.Picker(self.drafting.scene)
        self._previews = Previews()
        steps = {"Undo": session.undo, "Redo": session.redo}
        title = f"DroneCATS · {scene_name}"
        self._panels = Panels(self._server, self.drafting, title, steps, self.do, self.save, self.select)
        self._view = SceneView(self._server, self.drafting, self.moved, session.settle)
        self._view.frame(session.draft)
        self._pictures = NewestItemWorker(self._draw, "editor-picture")
        self._checks = NewestItemWorker(self._check, "editor-checks")
        session.changed = self._changed
        self._server.scene.on_click()(self._clicked)
        self._changed(session.draft, "")

    def idle(self, timeout_s: float) -> bool:
        """Wait until the picture and the checks show the current draft; return False after the timeout."""
        return self._pictures.idle(timeout_s) and self._checks.idle(timeout_s)

    def close(self) -> None:
        """End the threads and the server."""
        self._pictures.close()
        self._checks.close()
        self._previews.close()
        self._server.stop()

    # ---- calls from the panels

    def do(self, operation: DraftOperation, client: Any) -> None:
        """Change the draft, or show the error to the client."""
        try:
            self.session.do(operation)
        except UsageError as error:
            self._refuse(client, error)

    def save(self, replace: bool, client: Any) -> None:
        record = self.session.record
        try:
            path = self.session.save(replace)
        except UsageError as error:
            self._panels.show_note(str(error), replaceable="replace the file" in str(error))
            self._refuse(client, error)
            return
        red = sum(not f.passed for f in self.findings)
        checks = "the checks are still running" if self.checked != record else f"{red} checks are red" if red else ""
        self._panels.show_note(f"Written: {path}" + (f" ({checks})" if checks else ""))

    def select(self, drone: int) -> None:
        self._panels.show(self.session.draft)
        self._pictures.put((self.session.record, drone))

    # ---- drags and clicks in the scene

    def moved(self, name: str, north: float, east: float, yaw_deg: float) -> None:
        kind, _, number = name.partition("-")
        which = int(number or 0)
        operations: dict[str, DraftOperation] = {
            "target": lambda d: self.drafting.move_target(d, north, east, yaw_deg),
            "waypoint": lambda d: self.drafting.move_waypoint(d, which, north, east),
            "drone": lambda d: self.drafting.move_start(d, which, north, east, yaw_deg),
            "candidate": lambda d: self.drafting.move_candidate(d, which - 1, north, east, yaw_deg),
        }
        with contextlib.suppress(UsageError, IndexError):  # the object was removed during the drag
            self.session.do(operations[kind], gesture=name)

    def _clicked(self, event: Any) -> None:
        """Apply a click on the map. The panel selects the effect."""
        meaning = self._panels.click
        if not meaning:
            return
        hit = self._picker.pick(display.ned_of(event.ray_origin), display.ned_of(event.ray_direction))
        if hit is None:
            return
        (north, east, _), instance = hit
        operations: dict[str, DraftOperation] = {
            "target": lambda d: self.drafting.move_target(d, north, east),
            "waypoint": lambda d: self.drafting.add_waypoint(d, north, east),
            "drone": lambda d: self.drafting.move_start(d, self._panels.drone, north, east),
            "candidate": lambda d: self.drafting.add_candidate(d, north, east),
            "native": lambda d: self.drafting.adopt(d, instance.name),
        }
        self.do(operations[meaning], event.client)

    # ---- updates after a change

    def _changed(self, draft: Draft, gesture: str) -> None:
        """Show the current draft, which may be newer than `draft`: several threads make changes."""
        with self._showing:
            now = self.session.draft
            self._view.show(now)
            self._panels.show(now)
            self._panels.show_checks(self.findings, fresh=self.checked == now.record)
            if not gesture:
                self._panels.show_note("")
            self._pictures.put((now.record, self._panels.drone))
            self._checks.put(now.record)

    def _draw(self, wanted: tuple[EpisodeRecord, int]) -> None:
        record, drone = wanted
        drone = min(drone, len(record.starts) - 1)
        with contextlib.suppress(UsageError):  # the checks report the error in the record
            picture = self._previews.picture(record, drone)
            self._panels.show_picture(picture)
            self._view.show_view(drone, picture)

    def _check(self, record: EpisodeRecord) -> None:
        self.findings, self.checked = tuple(findings(record)), record
        self._panels.show_checks(self.findings, fresh=record == self.session.record)

    @staticmethod
    def _refuse(client: Any, error: UsageError) -> None:
        if client is not None:
            client.add_notification("Not possible", str(error), auto_close_seconds=8.0, color="red")


def open_session(name: str, folder: Path) -> tuple[Session, str]:
    """Return a session for a map (by name) or an episode (by id or file), and its title. Raises UsageError."""
    if name in maps.names():
        drafting = Drafting(maps.build(name))
        return Session(drafting, drafting.new(name), folder), name
    try:
        catalogue.must_exist(name)
    except UsageError:
        near = nearest(name, [*maps.names(), *catalogue.all_ids()]) or maps.names()
        hint = f"{did_you_mean(near)} See: dronecats maps list, dronecats episodes list"
        raise UsageError(f"{name[:80]!r} is not a map, an episode or a record file: {hint}") from None
    record = catalogue.load(name)
    drafting = Drafting(maps.build(record.map, record.map_seed))
    return Session(drafting, drafting.opened(record), folder), record.id
