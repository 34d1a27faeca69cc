"""After a flight on a vehicle that we did not start: the trace of its estimator, and the flight judged by it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from dronecats.judge.distances import sentence
from dronecats.judge.episode import write_verdict
from dronecats.report.afterflight.surveyed_target import SurveyedTarget
from foundation.errors import UsageError
from foundation.run_folder.writing import as_json


def rejudge(result: dict[str, Any], target: SurveyedTarget | None, say: Callable[[str], None]) -> dict[str, Any]:
    """Return what `fly --json` prints, judged anew with estimate.jsonl; as it was where the logs allow no trace."""
    from dronecats.report.afterflight.trace import derive

    folder = Path(result["run_dir"])
    try:
        derive(folder, target)
    except UsageError as reason:
        say(f"no smoothed trace: {reason}")
        return result
    verdict = write_verdict(folder)
    measured = verdict.distances or None
    if measured:
        say(sentence(measured, verdict.delta_m))
    return {**result, "outcome": verdict.outcome, "success": verdict.success, "distances": as_json(measured)}
