"""What happened to the vehicles beside their task: contacts and estimator resets. None of it enters an outcome."""

from foundation.run_folder.reading import Logs
from foundation.run_folder.results import Contacts
from foundation.run_folder.rows import Clear, Hit, Reset


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
