"""One person's editing: the draft of now, the drafts before it, and the file it is written to."""

import threading
from collections.abc import Callable
from pathlib import Path

from dronecats.view.editor.draft import Draft, Drafting
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord, parse
from foundation.errors import UsageError
from foundation.whole_file import write_text

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
        if record.id in catalogue.known() and path.resolve() != (catalogue.FOLDER / path.name).resolve():
            raise UsageError(f"'{record.id}' is the id of an episode that ships: give yours another one.")
        if path.exists() and not replace:
            raise UsageError(f"'{path}' exists already: give the episode another id, or replace the file.")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_text(path, text)
        except OSError as error:
            raise UsageError(f"'{path}' cannot be written: {error.strerror}.") from None
        return path
