"""How a reply is awaited, and what becomes of one that is still under way when the episode is over."""

from collections.abc import Callable, Generator, Iterator

from dronecats.agent.asking import Asking
from foundation.errors import ModelError


def await_reply(
    asking: Asking,
    now_s: Callable[[], float],
    asked_s: float,
    cap_s: float,
    patience_s: float | None = None,
    last_reply: bool = True,
) -> Generator[None, None, bool]:
    """Yield until the reply is due, or the episode over; return whether it is due.

    Times are vehicle seconds since the episode began. `last_reply`: one still under way at `cap_s` is outlasted.
    Raises ModelError beyond `patience_s` (None: the client's alone), and what the client raises.
    """
    while not asking.due(now_s()):
        yield
        if now_s() >= cap_s:
            break
        if patience_s is not None and now_s() > asked_s + patience_s:
            raise ModelError(f"the model has not answered for {patience_s:g} s: no decision, no flight")
    if asking.due(now_s()):
        return True
    if last_reply:
        yield from outlast(asking, lambda: now_s() - asked_s, patience_s)
    return False


def outlast(asking: Asking, waited_s: Callable[[], float], patience_s: float | None = None) -> Iterator[None]:
    """Yield until the model has answered, or its client has given it up. Raises what the client raises.

    waited_s: vehicle seconds since the question; beyond patience_s (None: the client's alone) raises ModelError.

    Whatever it answers comes too late to be an action. But a model that is slow has failed, and one that is dead has
    not, and only waiting tells them apart: an endpoint that hangs must not be scored as a pilot's failure.
    """
    while not asking.answered:
        yield
        if patience_s is not None and waited_s() > patience_s:
            raise ModelError(f"the model has not answered for {patience_s:g} s, nor when the episode was over")
    asking.reply()
