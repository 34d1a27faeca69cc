"""A trained head as a pilot: from the prompt and the pictures of a request to the text of a reply."""

import threading
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots import actions
from dronecats.pilots.actions import Pilot
from examples.action_head import features
from examples.action_head.decide import Outlook, decide
from foundation.errors import UsageError


class Beholder(Protocol):
    """Whatever makes an outlook of a picture: the network, or a test's own."""

    def outlook(self, picture: NDArray[np.uint8], words: NDArray[np.float32], past: NDArray[np.float32]) -> Outlook:
        """Return what it makes of one picture, an instruction's words and the last actions."""
        ...


def pilot(head: Beholder, declares_at: float) -> Pilot:
    """Return the pilot that a server serves; it remembers nothing, and answers one request at a time.

    Of a fleet each drone is asked as if it were alone. The pilot raises UsageError for a request without a picture.
    """
    turn = threading.Lock()

    def answer(prompt: str, pictures: list[bytes]) -> str:
        if not pictures:
            raise UsageError("The head wants a picture of each drone.")
        told = actions.read_prompt(prompt)
        words = features.words(told.command)
        replies = []
        for drone, jpeg in enumerate(pictures):
            past = told.past(drone)
            with turn:
                seen = head.outlook(features.picture(jpeg), words, features.history(past))
            replies.append(decide(seen, past, declares_at))
        return actions.join(replies)

    return answer
