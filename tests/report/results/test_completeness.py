"""Tests that missing episodes of a benchmark are counted."""

import json

from dronecats.report.recorded.run import recorded_runs
from dronecats.report.results.collection import unflown
from tests.report.results.synthetic_runs import write_run

IDS = ("campus-searching-01", "residential-approaching-01")


def test_planned_flights_without_a_folder_are_counted_as_missing(tmp_path):
    write_run(tmp_path / "oracle-1", IDS)
    write_run(tmp_path / "oracle-2", IDS[:1], seed=1)
    runs = recorded_runs([tmp_path])
    assert unflown(runs) == []
    planned_runs = [{"name": f"oracle-{k}", "flight": {}, "episodes": IDS} for k in (1, 2, 3)]
    (tmp_path / "bench.json").write_text(json.dumps({"runs": planned_runs}))
    (benchmark,) = unflown(runs)
    assert (benchmark.folder, benchmark.flights, benchmark.missing) == (tmp_path, 6, 3)
    assert unflown(recorded_runs([tmp_path / "oracle-1"]))[0].missing == 4, "whoever names one run alone is told too"
    (tmp_path / "bench.json").write_text(json.dumps({"runs": planned_runs[:1]}))
    assert unflown(runs) == []
