"""The delay at which a loop begins to oscillate, found by making it later and later."""

from collections.abc import Callable

from dronecats.study.loop.linear import DelayMargin
from dronecats.study.loop.oscillation import Oscillation
from foundation.errors import UsageError

WITHIN = 1e-3  # of the delay: how far apart the last two trials are
LATEST = 8.0  # × the expected margin: later is not tried


def injected_margin(oscillates: Callable[[float], Oscillation | None], expected_s: float) -> DelayMargin:
    """Return the delay at which the damping ratio is 0, between the last trial that fades and the first that grows.

    `oscillates` tells what a small step leaves behind with a delay (s). Between the two, which bisection has brought
    within WITHIN, the damping ratio is taken to run straight. Raises UsageError where the loop fades however late.
    """
    fades, grows = 0.0, expected_s
    calm, wild = oscillates(fades), oscillates(grows)
    while wild is None or wild.growth <= 0.0:
        fades, calm, grows = grows, wild, 1.3 * grows
        if grows > LATEST * expected_s:
            raise UsageError(f"the loop does not oscillate with {grows:.2g} s of delay")
        wild = oscillates(grows)
    while grows - fades > WITHIN * grows:
        middle = 0.5 * (fades + grows)
        found = oscillates(middle)
        if found is not None and found.growth > 0.0:
            grows, wild = middle, found
        else:
            fades, calm = middle, found
    if calm is None:
        return DelayMargin(grows, wild.frequency)
    share = calm.damping_ratio / (calm.damping_ratio - wild.damping_ratio)
    return DelayMargin(fades + share * (grows - fades), wild.frequency)
