"""A study resumes only with its original options. A flight with other options does not count as done."""

import re
from dataclasses import replace

import pytest

from dronecats.bench.benchmark_folder import Bench
from dronecats.bench.matrix import choose_suite
from dronecats.flight.spec.disturbances import Disturbances, VehicleFaults
from dronecats.flight.spec.flight_spec import Simulated
from dronecats.study import folder
from foundation.errors import UsageError
from tests.study.test_plan import BLIND, LATENCY, ORACLE, TWO, fly, planned


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """The folder of a study with all flights flown."""
    out = tmp_path_factory.mktemp("begun") / "s"
    assert len(fly(out, planned(flights=1))) == 6
    return out


GUSTY = replace(ORACLE, disturbances=Disturbances(vehicle=VehicleFaults(gusts_w20=5.0)))


def test_a_resume_with_other_options_is_rejected_with_the_differences_for_any_pilot(begun):
    for changes, parts in (
        ({"seed": 6}, "seed, 5 .* 6 .*--out"),
        ({"seconds": 20.0}, "seconds, 300.0 .* 20.0 "),
        ({"full": True, "parser": "lenient"}, 'parser, "strict" .* "lenient" .*full, false '),
        ({"disturbances": GUSTY.disturbances}, "disturbances.vehicle.gusts_w20, 0.0 .* 5.0 "),
    ):
        for pilot in ("oracle", "blind"):
            spec = replace(ORACLE if pilot == "oracle" else BLIND, **changes)
            with pytest.raises(UsageError) as no:
                folder.merge_earlier_runs(begun, planned(pilots=[(pilot, spec)], flights=1))
            assert re.search(parts, str(no.value)), (pilot, changes)
            assert str(no.value).startswith(f"{begun / 'oracle-latency-0-f1'} "), (pilot, changes)


def test_a_study_resumes_unchanged_or_with_other_pilots_or_more_flights(begun):
    for made in (planned(flights=1), planned(flights=2), planned(pilots=[("ring", BLIND)], flights=1)):
        folder.merge_earlier_runs(begun, made)
    vision = replace(BLIND, pilot="vision", simulated=Simulated(speed=None, rendered=True))
    assert len(folder.merge_earlier_runs(begun, planned(pilots=[("vision", vision)], flights=1)).runs) == 6


def test_a_run_with_the_same_name_but_other_levels_is_rejected(begun, tmp_path):
    study = folder.read(begun)
    first, *others = study.runs
    folder.write(tmp_path, replace(study, runs=(replace(first, levels={"latency": 2.0}), *others)))
    (tmp_path / "bench.json").write_bytes((begun / "bench.json").read_bytes())
    with pytest.raises(UsageError, match=r"oracle-latency-0-f1 .* levels .*oracle-latency-0-f1 .*--out"):
        folder.merge_earlier_runs(tmp_path, planned(flights=1))


def test_a_rejected_resume_changes_no_file(begun):
    before = {path: path.read_bytes() for path in begun.rglob("*.json")}
    made = planned((LATENCY,), [("blind", replace(BLIND, seed=6))], flights=1)
    with pytest.raises(UsageError, match=r"seed, 5 .* 6 "):
        Bench(
            begun, choose_suite(TWO, ()), made.entries, retry=False,
            first=lambda: folder.write(begun, folder.merge_earlier_runs(begun, made)),
        )  # fmt: skip
    assert {path: path.read_bytes() for path in begun.rglob("*.json")} == before
