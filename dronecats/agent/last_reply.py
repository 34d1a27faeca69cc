"""What becomes of a reply that is still under way when the episode is over."""

from collections.abc import Callable, Iterator

from dronecats.agent.asking import Asking
from foundation.errors import ModelError


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
