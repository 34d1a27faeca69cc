"""Every line of a flight's folder conforms to the published schemas, with and without ground truth."""

import json
import shutil

import jsonschema
import pytest

from dronecats.judge.episode import write_verdict
from dronecats.report.afterflight import SurveyedTarget, derive
from foundation.run_folder import layout
from tests.foundation.run_folder.published import check, validator
from tests.support.flown_runs import ALONE


@pytest.fixture(scope="module")
def copied_flight(rendered_run, tmp_path_factory):
    """Return a copy of one episode folder and the result of its flight."""
    run = tmp_path_factory.mktemp("copy") / "run"
    shutil.copytree(rendered_run.run, run)
    return run / ALONE, rendered_run.results[0]


def test_every_line_conforms_to_its_schema(copied_flight):
    folder, result = copied_flight
    validator("result").validate(result)
    derive(folder)
    counted = {name: check(folder / name) for name in (layout.DECISIONS, layout.TRUTH, layout.ESTIMATE, layout.VERDICT)}
    assert check(folder.parent / layout.RUN) == counted[layout.VERDICT] == 1
    assert counted[layout.DECISIONS] == result["steps"] > 3
    assert counted[layout.TRUTH] > 2 * counted[layout.DECISIONS]
    assert counted[layout.ESTIMATE] > counted[layout.DECISIONS]


def test_a_flight_without_ground_truth_conforms_to_the_schemas(copied_flight, tmp_path):
    folder = tmp_path / ALONE
    shutil.copytree(copied_flight[0], folder)
    truth_rows = [json.loads(line) for line in (folder / layout.TRUTH).read_text().splitlines()]
    begin, *_, end = truth_rows
    unknown = {"target_ned": None, "distance_m": None, "visible": None}
    poses = [{**row, **unknown} for row in truth_rows if row["kind"] == "pose"]
    rows = [{**begin, "source": "estimate"}, *poses, end]
    (folder / layout.TRUTH).write_text("".join(json.dumps(row) + "\n" for row in rows))
    derive(folder, SurveyedTarget(47.4, 8.5456, None))
    verdict = write_verdict(folder)
    assert verdict.outcome in ("distance only", "error")
    assert verdict.distances
    for name in (layout.TRUTH, layout.ESTIMATE, layout.VERDICT):
        assert check(folder / name)


def test_the_verdict_schema_rejects_invalid_values(copied_flight):
    verdict = json.loads((copied_flight[0] / layout.VERDICT).read_text())
    changes: list[dict[str, object]] = [{"outcome": "solved"}, {"steps": -1}, {"drones": [{}]}, {"deciding": 3}]
    for change in changes:
        with pytest.raises(jsonschema.ValidationError):
            validator("verdict").validate({**verdict, **change})
