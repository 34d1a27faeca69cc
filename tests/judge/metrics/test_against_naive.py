"""Compares every metric of the registry with a second, naive implementation on random logs."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.failure_mode import MODES, failure_mode
from dronecats.judge.metrics.judging import METRICS
from foundation.run_folder.results import Contacts
from tests.judge.episode_logs import logs
from tests.judge.metrics import naive
from tests.judge.metrics.episodes import CAP_S, flights, judged_flight

END = {"kind": "end", "t": CAP_S, "reason": "cap", "error": None}
ROUNDED = 2e-3  # verdict.json rounds the values of each drone to 0.001


def test_every_metric_has_a_second_implementation():
    assert set(naive.METRICS) == set(METRICS)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(flights())
def test_every_metric_agrees_with_its_second_implementation(rows):
    episode = judged_flight(rows, END)
    plainly = naive.Episode(rows[0], rows[1], rows[2], episode)
    assert episode.verdict.outcome == plainly.outcome
    for name, metric in METRICS.items():
        computed, expected = metric.of(episode), naive.METRICS[name](plainly)
        if metric.level == "step":
            assert isinstance(computed, list)
            assert len(computed) == len(rows[0]), name
            assert computed == [v if v is None else pytest.approx(v, abs=2e-5) for v in expected], name
        else:
            assert computed == (expected if expected is None else pytest.approx(expected, abs=ROUNDED)), name
        for value in computed if isinstance(computed, list) else [computed]:
            assert value is None or type(value) is bool or metric.unit != "share", name
            assert value is None or type(value) is int or metric.unit != "count", name


INCIDENTS = ("hits", "crashes", "hardest_hit_mps", "contact_s", "estimator_resets")


def test_hits_and_resets_are_none_if_the_log_does_not_record_them():
    begin = {"kind": "begin", "t": 0.0, "t0_us": 5, "cap_s": CAP_S}
    episode = JudgedFlight(Path("somewhere"), {}, logs(begin=begin, end=END), 5.0, CAP_S)
    assert [METRICS[name].of(episode) for name in INCIDENTS] == [None] * len(INCIDENTS)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(flights())
def test_hits_and_resets_change_only_their_own_fields_of_a_verdict(rows):
    decisions, truth, record = rows
    quiet = [row for row in truth if row["kind"] not in ("hit", "clear", "reset")]
    crash = {"kind": "hit", "t": 0.1, "drone": 0, "what": "the ground", "closing_speed": None, "crash": True}
    reset = {"kind": "reset", "t": 0.2, "drone": 0, "count": 3, "quantities": ["position"], "yaw_deg": 0.0,
             "position_m": 60.0, "height_m": 0.0, "velocity_mps": 0.0}  # fmt: skip
    calm, rough = (
        judged_flight((decisions, truth_rows, record), END).verdict for truth_rows in (quiet, [*truth, crash, reset])
    )
    assert isinstance(rough.contacts, Contacts)
    assert rough.contacts.crashes >= 1
    assert calm != rough
    assert calm == replace(rough, contacts=calm.contacts, estimator_resets=calm.estimator_resets)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(flights(), st.sampled_from([END, {**END, "t": 9.0, "reason": "decided"}, None]))
def test_every_scored_flight_has_exactly_one_mode(rows, end):
    episode = judged_flight(rows, end)
    mode = failure_mode(episode)
    assert (mode is not None) == (episode.verdict.outcome in ("success", "failure"))
    assert (mode == "success") == (episode.verdict.outcome == "success")
    assert mode is None or mode in MODES
