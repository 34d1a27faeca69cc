"""The audit cases of the paper as scripted flights, each with its expected verdict under every rule."""

from pathlib import Path

import pytest

from dronecats.cli.main import main
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.audit import RULES, Followed, audit, audit_of, deliberation, flips, step_outlooks
from tests.judge.episode_logs import BEGIN, END, decision, frame, logs, pose, write

INSIDE, OUTSIDE, HIDDEN = (4.0, True), (9.0, True), (4.0, False)
DECIDED_AT = {"kind": "end", "t": 13.0, "reason": "decided", "error": None}


def scripted(declared, entered=False, end=END, cell="approaching", trace=()):
    """Return a flight with a distant `go` step and then declarations: (time (s), (distance (m), in view))."""
    decisions = [decision(0, 0, 1.0, "go"), *(decision(k, k, t) for k, (t, _) in enumerate(declared, 1))]
    truth = [frame(0, 0.5, 20.0), *(frame(k, t - 0.5, *where) for k, (t, where) in enumerate(declared, 1))]
    truth += [pose(40.0, 4.9 if entered else 20.0, True), *trace]
    return JudgedFlight(Path("somewhere"), {"cell": cell}, logs(decisions, truth, end=end))


def held(seconds, broken_at=None):
    """Return poses within the radius and in view for `seconds`, except at the time `broken_at`."""
    return [pose(100 + k / 2, 4.0, k / 2 != broken_at) for k in range(int(2 * seconds))] + [
        pose(100 + seconds, 9.0, True)
    ]


BURST = [(502.0 + 5 * k, INSIDE) for k in range(7)]
Case = tuple[JudgedFlight, bool, dict[str, bool | None]]  # flight, success, and other results by rule
CASES: dict[str, Case] = {
    "declares 0.2 s after the cap": (scripted([(300.2, INSIDE)]), False, {"no_cap": True, "proximity": True}),
    "declares on the cap": (scripted([(300.0, INSIDE)]), True, {}),
    "outside, then inside": (scripted([(10.0, OUTSIDE), (20.0, INSIDE)]), True, {"first": False}),
    "inside, then outside": (scripted([(10.0, INSIDE), (20.0, OUTSIDE)]), True, {"last": False}),
    "inside, but hidden": (scripted([(10.0, HIDDEN)]), False, {"proximity": True}),
    "never declares, but enters": (scripted([], entered=True), False, {"proximity": True}),
    "never declares nor enters": (scripted([]), False, {}),
    "a burst after the shutdown": (scripted(BURST, end={**END, "t": 300.98}), False, {"no_cap": True}),
    "cut off at its success": (scripted([(10.0, OUTSIDE), (12.0, INSIDE)], end=DECIDED_AT), True,
                               {"first": False, "last": None}),
    "tracks, declares, and does not stay": (scripted([(10.0, INSIDE)], cell="tracking"), True, {"dwell": False}),
    "tracks for ten seconds without a word": (scripted([], cell="tracking", trace=held(10.0)), False,
                                              {"dwell": True, "proximity": True}),
    "loses it after five seconds": (scripted([], cell="tracking", trace=held(10.0, broken_at=5.0)), False,
                                    {"dwell": False, "proximity": True}),
    "the same with a target that stands": (scripted([], trace=held(10.0)), False, {"proximity": True}),
}  # fmt: skip


def test_every_audit_case_has_its_expected_result_under_every_rule():
    for name in CASES:
        flight, success, otherwise = CASES[name]
        audited = audit_of(flight)
        assert audited.success is success, name
        dwell = success if flight.cell == "tracking" else None
        assert audited.rules == {**dict.fromkeys(RULES, success), "dwell": dwell, **otherwise}, name


def test_the_summary_of_all_audit_cases_has_the_expected_counts():
    summary = audit(audit_of(flight) for flight, *_ in CASES.values())
    assert (summary.episodes, summary.scored, summary.successes) == (13, 13, 5)
    assert (summary.late_declarations, summary.late_episodes) == (8, 2)
    assert (summary.declarations, summary.false_declarations) == (9, 4)
    assert (summary.silent_failures, summary.silent_entered) == (7, 5)
    turned = {name: (flip.decided, flip.successes, flip.lost, flip.gained) for name, flip in summary.flips.items()}
    assert turned == {
        "first": (13, 5, 2, 0), "last": (12, 4, 1, 0), "dwell": (3, 1, 1, 1), "proximity": (13, 5, 0, 6),
        "no_cap": (13, 5, 0, 2),
    }  # fmt: skip


def test_unscored_flights_flip_no_rule():
    broken = audit_of(scripted([], entered=True, end=None))
    assert set(broken.rules.values()) == {None}
    assert (audit([broken, None]).episodes, audit([broken, None]).scored) == (2, 0)
    assert flips([(None, True), (True, None)]).decided == 0


def steps(rows):
    """Return a flight with one row (action, distance, in view) per step."""
    decisions = [decision(k, k, 2.0 + 2.5 * k, action) for k, (action, *_) in enumerate(rows)]
    truth = [frame(k, 1.5 + 2.5 * k, *where) for k, (_, *where) in enumerate(rows)]
    return JudgedFlight(Path("somewhere"), {}, logs(decisions, truth))


def test_the_gain_after_a_think_is_compared_with_steps_of_equal_closing_distance():
    # the think (step 1) and the go (step 7) both close 1 m; the steps after them close 2 m and 1 m each
    away = [21.0, 20.0, 20.0, 18.0, 16.0, 14.0, 13.0, 12.0, 11.0, 10.0, 9.0, 8.0]
    flight = steps([("think" if k == 1 else "go", m, True) for k, m in enumerate(away)])
    by_step = step_outlooks(flight)
    assert (by_step[1].think, by_step[1].closing_m, by_step[1].gained_m) == (True, 1.0, 2.0)
    assert (by_step[0].closing_m, by_step[9].gained_m) == (None, None)
    gains = [
        outlook.gained_m
        for outlook in by_step
        if not outlook.think and outlook.closing_m == 1.0 and outlook.gained_m is not None
    ]
    assert gains == [1.0, 1.0]  # steps 6 and 7
    thought = deliberation(by_step)
    assert (thought.thinks, thought.matched, thought.gain_m_per_step) == (1, 1, 1.0)
    assert deliberation([]).gain_m_per_step is None


def test_broken_stalls_and_regained_targets_are_counted():
    still = [("go", 10.0, True)] * 3
    broken = steps([*still, ("think", 10.0, True), ("go", 10.0, True), ("go", 9.5, True), ("go", 9.0, True),
                    ("go", 9.0, True)])  # fmt: skip
    assert [outlook.stalled for outlook in step_outlooks(broken)][:4] == [None, None, None, True]
    assert deliberation(step_outlooks(broken)).stalls == Followed(think=1, of_thinks=1, other=0, of_others=0)
    less = steps([*still, ("go", 10.0, True), ("go", 10.0, True), ("go", 9.5, True), ("go", 9.0, True),
                  ("go", 9.01, True)])  # fmt: skip
    assert deliberation(step_outlooks(less)).stalls == Followed(think=0, of_thinks=0, other=0, of_others=1)
    lost = steps([("think", 9.0, False), ("go", 9.0, False), ("go", 9.0, False), ("go", 9.0, True), ("go", 9.0, False)])
    # the target is visible again within three frames of the think and the next two gos; the last is unknown
    assert deliberation(step_outlooks(lost)).losses == Followed(think=1, of_thinks=1, other=2, of_others=2)
    gone = steps([("think", 9.0, False)] + [("go", 9.0, False)] * 3)
    assert deliberation(step_outlooks(gone)).losses == Followed(think=0, of_thinks=1, other=0, of_others=0)


FENCED, QUOTED = '```json\n{"action": "finished"}\n```', "{'action': 'finished'}"


@pytest.mark.parametrize(
    ("reply", "mended", "changed", "success"),
    [(FENCED, ["fence"], 0, True), (QUOTED, ["single_quotes"], 1, False), ('{"action": "finished"}', None, 0, True)],
)
def test_strict_parsing_loses_declarations_in_single_quotes_but_not_fenced_ones(reply, mended, changed, success):
    more = {"reply": reply, **({"mended": mended} if mended else {})}
    flight = JudgedFlight(Path("x"), {}, logs([decision(0, 0, 5.0, **more)], [frame(0, 4.5, 4.0)]))
    strict = audit_of(flight).strict
    assert (strict.steps, strict.mended, strict.changed) == (1, bool(mended), changed)
    assert strict.success is success
    assert audit([audit_of(flight)]).strict.lost == changed


def test_a_flight_that_ends_at_a_mended_declaration_has_no_strict_result():
    """The rest of such a flight is unknown, so its result under strict parsing is None."""
    end = {**END, "reason": "decided", "t": 5.5}
    row = decision(0, 0, 5.0, reply=QUOTED, mended=["single_quotes"])
    strict = audit_of(JudgedFlight(Path("x"), {}, logs([row], [frame(0, 4.5, 4.0)], end=end))).strict
    assert (strict.changed, strict.success) == (1, None)


def test_the_command_prints_the_audit_of_runs(tmp_path, capsys):
    write(tmp_path / "run" / "e", [{**decision(0, 0, 5.0), "reply": '{"action": "finished"}'}],
          [BEGIN, frame(0, 4.5, 4.0), END])  # fmt: skip
    (tmp_path / "run" / "run.json").write_text("{}")
    assert main(["audit", str(tmp_path), "--json"]) == 0
    assert '"successes": 1' in capsys.readouterr().out
    assert main(["audit", str(tmp_path / "run")]) == 0
    assert main(["audit", str(tmp_path), "--cap", "0"]) == 2
