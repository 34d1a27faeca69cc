"""Two short flights of version 0.1.0 in lockstep (one drone, four drones), and the outputs made from them.

kept_run.tar.xz is their run folder. Its flight.tlog holds only the messages that the readers use, from one second
before the episode. kept_outputs.json holds the outputs of export, film, replay and report, made before
`RecordedFlight` was one class. `python -m tests.report.recorded.kept` regenerates it.
"""

import json
import tarfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dronecats.report.export.formats import export
from dronecats.report.recorded.run import recorded_runs
from dronecats.report.results.collection import collect
from dronecats.view.film.composition import action_words, verdict_words
from dronecats.view.film.plan import filmable
from dronecats.view.replay.moments import flight_moments

ARCHIVE, OUTPUTS = (Path(__file__).with_name(name) for name in ("kept_run.tar.xz", "kept_outputs.json"))
TIMES_S = (0.0, 1.3, 3.9, 9.0)


def unpacked(folder: Path) -> Path:
    """Unpack the run folder into a folder and return its path."""
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(folder, filter="data")
    return folder / "run"


def outputs(run: Path, out: Path) -> dict[str, Any]:
    """Return the outputs made from a run folder as JSON values. Exports are written to `out`."""
    results: dict[str, Any] = {}
    for kind in ("geojson", "csv"):
        export(kind, recorded_runs([run]), out)
    for folder in sorted(path for path in run.iterdir() if path.is_dir()):
        moments, flight = flight_moments(folder), filmable(folder)
        results[folder.name] = {
            "geojson": json.loads((out / f"{folder.name}.geojson").read_text()),
            "film": [
                verdict_words(flight)[0],
                *(action_words(flight, drone, t)[0] for drone in flight.drones for t in TIMES_S),
            ],
            "tracks": [[asdict(flight.tracks[drone].at(t)) for t in TIMES_S] for drone in flight.drones],
            "replay": [_moment(moments.moment(t)) for t in TIMES_S],
            "what happened": [[event.t_s, event.drone, event.kind.value, event.words] for event in moments.happened],
        }
    results["csv"] = {path.name: path.read_text().splitlines() for path in sorted(out.glob("*.csv"))}
    results["report"] = [
        {episode.episode: {**episode.values, "mode": episode.mode}} for episode in collect([run]).episodes
    ]
    rounded: dict[str, Any] = _rounded(json.loads(json.dumps(results)))
    return rounded


def _moment(moment: Any) -> dict[str, Any]:
    """Return a moment as a dict without images and without the moving target's path, which belongs to the world."""
    left_out = {"picture", "decided_on", "decision", "prompt"}
    drones = [{key: value for key, value in asdict(drone).items() if key not in left_out} for drone in moment.drones]
    steps = [drone.decision and drone.decision.step for drone in moment.drones]
    return {"drones": drones, "steps": steps, "judge": asdict(moment.judge), "state": moment.state, "t": moment.t_s}


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_rounded(inner) for inner in value]
    return round(value, 7) + 0.0 if isinstance(value, float) else value


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        made = outputs(unpacked(Path(folder)), Path(folder) / "out")
    parts = [f"{json.dumps(name)}: {json.dumps(part, ensure_ascii=False)}" for name, part in made.items()]
    OUTPUTS.write_text("{\n" + ",\n".join(parts) + "\n}\n")
