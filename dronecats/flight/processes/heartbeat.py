"""Whether a process that was asked for a sign of life still owes it, judged by whoever asks."""

EVERY_S = 1.0  # between an answer and the next question
GLANCE_S = 0.5  # the most that one look at the process counts: a pause of the asker's own is not held against it


class Heartbeat:
    """Pure: all times are the caller's, in seconds of one clock that never goes back."""

    def __init__(self, patience_s: float) -> None:
        """`patience_s` without an answer, and the process hangs."""
        self.patience_s = patience_s
        self._asked = False
        self._answered_s: float | None = None
        self._looked_s: float | None = None
        self._waited_s = 0.0

    def is_due(self, now_s: float) -> bool:
        """Return whether it is time to ask: never while an answer is owed, so that no questions pile up."""
        return not self._asked and (self._answered_s is None or now_s >= self._answered_s + EVERY_S)

    def asked(self, now_s: float) -> None:
        self._asked, self._looked_s, self._waited_s = True, now_s, 0.0

    def answered(self, now_s: float) -> None:
        self._asked, self._answered_s = False, now_s

    def owed_s(self, now_s: float) -> float:
        """Look, and return for how long an answer has been owed, 0 while none is.

        What counts is the time in which we were there to hear it: after a machine has slept, or a Ctrl-Z of ours, the
        process had no more chance to answer than we had to ask.
        """
        if not self._asked or self._looked_s is None:
            return 0.0
        self._waited_s += min(now_s - self._looked_s, GLANCE_S)
        self._looked_s = now_s
        return self._waited_s

    def hangs(self, now_s: float) -> bool:
        """Look, and return whether the answer has been owed for longer than patience lasts."""
        return self.owed_s(now_s) > self.patience_s

    @property
    def owes(self) -> bool:
        """Whether an answer is owed."""
        return self._asked
