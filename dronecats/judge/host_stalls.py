"""Which steps the host delayed, and not the model: on them a flight measures the machine that it was flown on.

Paper, "Throughput sensitivity": when host load slows the control loop, success falls with it. What a decision says of
the host is logged in real time alone; in lockstep the clock waits, and no host can delay anything.
"""

from collections.abc import Iterable

from foundation.run_folder.rows import Decision

# s of wall time × speed, above which a step is called delayed: a tenth of the 2.5 s for which a move is held, and five
# ticks of the 20 Hz on which setpoints are sent. A target at walking pace gets 0.35 m away meanwhile
STALL_S = 0.25


def host_stalls(decisions: Iterable[Decision]) -> int:
    """Return how many steps were delayed: by a simulator that fell behind, or a picture that did not come."""
    return len({each.step for each in decisions if delayed(each)})


def delayed(decision: Decision) -> bool:
    """Return whether the host delayed the step of a decision; a step of whose host nothing is known it did not."""
    told = (decision.host_lag_s, decision.frame_wait_s)
    return any(isinstance(each, float) and each > STALL_S for each in told)
