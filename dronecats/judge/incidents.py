"""What happened to the vehicles beside their task: contacts and estimator resets. None of it enters an outcome."""

from collections.abc import Iterable

from foundation.run_folder.reading import Logs
from foundation.run_folder.results import Contacts
from foundation.run_folder.rows import Clear, Decision, Hit, Reset

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


def hits_of(logs: Logs, cap_s: float) -> list[Hit] | None:
    """Return the hits within the cap; None where hits were not written."""
    written = logs.begin is not None and logs.begin.contacts is True
    return [hit for hit in logs.hits if hit.t <= cap_s] if written else None


def resets_of(logs: Logs, cap_s: float) -> list[Reset] | None:
    """Return the estimator resets within the cap; None where the autopilot did not send the counter."""
    written = logs.begin is not None and logs.begin.resets is True
    return [reset for reset in logs.resets if reset.t <= cap_s] if written else None


def contacts(logs: Logs, cap_s: float) -> Contacts | None:
    """Return what the drones flew into; None where hits were not written."""
    hits = hits_of(logs, cap_s)
    if hits is None:
        return None
    return Contacts(
        hits=len(hits),
        crashes=sum(hit.crash for hit in hits),
        hardest_hit_mps=max((hit.closing_speed for hit in hits if hit.closing_speed is not None), default=None),
        contact_s=_contact_s(logs, hits, cap_s),
    )


def estimator_resets(logs: Logs, cap_s: float) -> int | None:
    """Return how often the drones' estimators were reset; None where the autopilot did not send the counter."""
    resets = resets_of(logs, cap_s)
    return None if resets is None else sum(reset.count for reset in resets)


def _contact_s(logs: Logs, hits: list[Hit], cap_s: float) -> float:
    """Return the seconds in contact with anything, of all drones; a contact that the end cut off lasts until then."""
    total, open_since = 0.0, dict[int, float]()
    rows: list[Hit | Clear] = [*hits, *logs.clears]
    for row in sorted(rows, key=lambda row: row.t):
        if isinstance(row, Hit):
            open_since.setdefault(row.drone, row.t)
        elif (since := open_since.pop(row.drone, None)) is not None:
            total += min(row.contact_s, cap_s - since)
    end_s = min(cap_s, logs.end.t if logs.end else cap_s)
    return round(total + sum(max(end_s - since, 0.0) for since in open_since.values()), 2)
