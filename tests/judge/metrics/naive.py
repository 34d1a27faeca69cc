"""A second, simple implementation of every metric, computed directly from the rows of the log files."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dronecats.judge.judged_flight import JudgedFlight
from tests.judge.test_diagnostics import Naive

Row = dict[str, Any]


@dataclass
class Episode:
    decisions: list[Row]
    truth: list[Row]
    record: Row | None
    judged: JudgedFlight
    delta_m: float = 5.0
    cap_s: float = 30.0

    @property
    def frames(self):
        return [row for row in self.truth if row["kind"] == "frame"]

    @property
    def samples(self):
        """All poses and frames until the cap, and later frames that a decision before the cap refers to."""
        acted = {(d["drone"], d["frame_id"]) for d in self.decisions if d["t_decided"] <= self.cap_s}
        poses = [row for row in self.truth if row["kind"] == "pose" and row["t"] <= self.cap_s]
        return poses + [f for f in self.frames if f["t"] <= self.cap_s or (f["drone"], f["frame_id"]) in acted]

    def frame(self, d):
        matches = [f for f in self.frames if f["frame_id"] == d["frame_id"] and f["drone"] == d["drone"]]
        return matches[0] if matches and abs(matches[0]["t"] - d["t_frame"]) < 1e-3 else None

    @property
    def counted(self):
        return [d for d in self.decisions if d["t_decided"] <= self.cap_s]

    def kind(self, d):
        return d["action"]["action"] if d["action"] else None

    @property
    def claims(self):
        declarations = [d for d in self.counted if self.kind(d) == "finished"]
        return sorted(declarations, key=lambda d: (d["t_decided"], d["step"], d["drone"]))

    def good(self, d):
        f = self.frame(d)
        if f is None:
            return None
        if f["distance_m"] > self.delta_m or f["visible"] is False:
            return False
        return None if f["visible"] is None else True

    @property
    def won(self):
        return any(self.good(d) for d in self.claims)

    @property
    def outcome(self):
        if self.won:
            return "success"
        if any(self.good(d) is None for d in self.claims) or not self.decisions or not self.measured_rows:
            return "error"
        return "failure"

    @property
    def measured_rows(self):
        return [r for r in self.truth if r["kind"] not in ("begin", "hit", "clear", "reset")]

    @cached_property
    def figures(self):
        return [Naive(self.judged.logs, drone, self.delta_m, self.cap_s).figures() for drone in self.drones()]

    def drones(self):
        return sorted({row["drone"] for row in self.samples})

    def per_drone(self, name):
        return [figures[name] for figures in self.figures if figures[name] is not None]

    def gos(self, d):
        return (*d["action"]["point"], d["action"]["depth_m"]) if self.kind(d) == "go" else None

    def questions(self, key):
        """Return a key's value for each decision. Only the first decision of each question has a value."""
        values, seen_steps = [], set()
        for d in self.decisions:
            elsewhere = "confirmed_by" in d or d["step"] in seen_steps or d["t_decided"] > self.cap_s
            values.append(None if elsewhere else d[key])
            seen_steps.add(d["step"])
        return values

    def every(self, value):
        return [None if d["t_decided"] > self.cap_s else value(d) for d in self.decisions]

    def seen(self, d):
        f = self.frame(d)
        return f if f and f["visible"] else None


def scored(of):
    return lambda e: of(e) if e.outcome in ("success", "failure") else None


def within(count):
    def of(e):
        verdicts = [e.good(d) for d in e.claims][:count]
        if True in verdicts:
            return True
        return None if None in verdicts or e.outcome == "error" else False

    return scored(of)


def least(name):
    return lambda e: min(e.per_drone(name), default=None)


def most(name):
    return lambda e: max(e.per_drone(name), default=None)


def ne(e):
    if e.outcome == "error":
        return None
    if e.won:
        return e.frame(next(d for d in e.claims if e.good(d)))["distance_m"]
    last = [[d for d in e.counted if d["drone"] == k][-1] for k in {d["drone"] for d in e.counted}]
    frames = [e.frame(d) for d in last]
    return None if None in frames or not frames else min(f["distance_m"] for f in frames)


def declared_to_start(e):
    good = [d for d in e.claims if e.good(d)]
    if not e.claims:
        return None
    d = good[0] if good and e.outcome == "success" else e.claims[0]
    f = e.frame(d)
    start = sorted((r["t"], r["kind"] == "frame", r["distance_m"]) for r in e.samples if r["drone"] == d["drone"])
    return None if f is None or not start else f["distance_m"] / start[0][2]


def on_target(e, d):
    f = e.seen(d)
    if not e.gos(d) or not f or not f["target_box"]:
        return None
    x, y, _ = e.gos(d)
    inside = np.array([[x, y]] * 2) - np.array(f["target_box"]).reshape(2, 2)
    return bool((inside[0] >= 0).all() and (inside[1] <= 0).all())


def angle(e, d):
    f = e.seen(d)
    if not e.gos(d) or not f or not f["target_frd"]:
        return None
    x, y, _ = e.gos(d)
    ray = np.linalg.inv(np.array([[640.0, 0.0, 640.0], [0.0, 640.0, 360.0], [0.0, 0.0, 1.0]])) @ [
        x * 1.28,
        y * 0.72,
        1.0,
    ]  # right, down, ahead
    true = np.array([f["target_frd"][1], f["target_frd"][2], f["target_frd"][0]])
    if not np.linalg.norm(true):
        return 0.0
    cosine = ray @ true / np.linalg.norm(ray) / np.linalg.norm(true)
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def depth(e, d):
    return e.gos(d)[2] - e.frame(d)["oracle_depth_m"] if on_target(e, d) else None


def rescaled(e):
    flags: list[bool | None] = []
    for k, d in enumerate(e.decisions):
        own = [p for p in e.decisions[:k] if p["drone"] == d["drone"] and p["action"]][-5:]
        before = [e.gos(p) for p in own if e.gos(p)]
        if not e.gos(d) or not before or d["t_decided"] > e.cap_s:
            flags.append(None)
            continue
        (x, y, _), (u, v, _) = before[-1], e.gos(d)
        same = abs(1.28 * x - x) <= 0.5 and abs(0.72 * y - y) <= 0.5
        flags.append(None if same else abs(1.28 * x - u) <= 0.5 and abs(0.72 * y - v) <= 0.5)
    return flags


def wide(e):
    return e.every(lambda d: abs(d["action"]["angle_deg"]) > 90 if e.kind(d) == "rotate" else None)


def numbers(values):
    return [float(v) for v in values if v is not None]


def middle(values):
    floats = numbers(values)
    return float(np.median(floats)) if floats else None


def average(values):
    floats = numbers(values)
    return float(np.mean(floats)) if floats else None


def share_of(values, at):
    floats = numbers(values)
    return float(np.quantile(floats, at)) if floats else None


def total(values):
    floats = numbers(values)
    return sum(floats) if floats else None


def outcomes(e):
    """Return the outcome of each drone, or None if one of them is unknown."""
    if not e.record or e.record["cell"] != "commanding" or not e.drones():
        return None
    by_drone = dict.fromkeys(e.drones(), "silent")
    unknown = False
    for k in {d["drone"] for d in e.claims} | set(by_drone):
        own = [d for d in e.claims if d["drone"] == k]
        if any(e.good(d) for d in own):
            by_drone[k] = "found"
            continue
        unknown |= any(e.good(d) is None or e.frame(d) is None for d in own)
        foes = [[*c["position_ned"][:2], -0.5] for c in e.record["candidates"]]
        near = [math.dist(e.frame(d)["position_ned"], foe) <= 5.0 for d in own if e.frame(d) for foe in foes]
        by_drone[k] = "silent" if not own else "beside" if any(near) else "elsewhere"
    return None if unknown else by_drone


def count_drones(outcome):
    return lambda e: None if outcomes(e) is None else sum(v == outcome for v in outcomes(e).values())


def commanding_metric(name):
    """Return a metric of commanding. `tests/judge/test_commanding.py` checks it with a second implementation."""

    def of(e):
        commanding = e.judged.verdict.commanding
        return getattr(commanding, name) if commanding else None

    return of


def one_candidate(e):
    commanding = e.judged.verdict.commanding
    if not commanding or not commanding.all_go_steps:
        return None
    steps = [s for s in commanding.steps if s.identical_point is not None]
    return sum(len(set(s.nears)) == 1 and s.nears[0] is not None for s in steps) / len(steps)


def struck(e):
    return [row for row in e.truth if row["kind"] == "hit" and row["t"] <= e.cap_s]


def contact_s(e):
    """Return the contact time of all drones (s), counted in ticks of 1/16 s."""
    ticks = 0
    for drone in {row["drone"] for row in struck(e)}:
        mine = [row for row in e.truth if row.get("drone") == drone]
        clears = [row["t"] for row in mine if row["kind"] == "clear"]
        times = [(c["t"] - 0.5 - c["contact_s"], c["t"] - 0.5) for c in mine if c["kind"] == "clear"]
        late = [row["t"] for row in mine if row["kind"] == "hit" and row["t"] > max(clears, default=-1.0)]
        times += [(min(late), e.cap_s)] if late else []
        ticks += sum(any(a <= k / 16 < b for a, b in times) for k in range(round(16 * e.cap_s)))
    return ticks / 16


METRICS = {
    "hits": lambda e: len(struck(e)),
    "crashes": lambda e: sum(row["crash"] for row in struck(e)),
    "hardest_hit_mps": lambda e: max((r["closing_speed"] for r in struck(e) if r["closing_speed"]), default=None),
    "contact_s": contact_s,
    "estimator_resets": lambda e: sum(r["count"] for r in e.truth if r["kind"] == "reset" and r["t"] <= e.cap_s),
    "success": scored(lambda e: e.won),
    "oracle_success": lambda e: any(r["distance_m"] <= 5.0 for r in e.samples) if e.samples else None,
    "declared": scored(lambda e: bool(e.claims)),
    "ne_m": ne,
    "declared_to_start": declared_to_start,
    "declarations": lambda e: len(e.claims),
    "declarations_after_cap": lambda e: sum(e.kind(d) == "finished" and d["t_decided"] > e.cap_s for d in e.decisions),
    "false_declarations": lambda e: (
        None if None in [e.good(d) for d in e.claims] else sum(not e.good(d) for d in e.claims)
    ),
    "declaration_precision": lambda e: (
        None if not e.claims or None in [e.good(d) for d in e.claims] else sum(map(e.good, e.claims)) / len(e.claims)
    ),
    "success_at_first": within(1),
    "success_within_three": within(3),
    "min_distance_m": lambda e: min((r["distance_m"] for r in e.samples), default=None),
    "min_distance_box_m": lambda e: min(
        numbers(f["distance_box_m"] for f in e.frames if f["t"] <= e.cap_s), default=None
    ),
    "start_distance_m": least("start_distance_m"),
    "approach_ratio": most("approach_ratio"),
    "first_acquisition_s": lambda e: min((r["t"] for r in e.samples if r["visible"]), default=None),
    "dwell_s": most("dwell_s"),
    "longest_loss_s": least("longest_loss_s"),
    "path_m": lambda e: sum(e.per_drone("path_m")) if e.drones() else None,
    "flown_s": lambda e: max((r["t"] for r in e.samples), default=None),
    "rate_hz": lambda e: e.questions("rate_hz"),
    "latency_s": lambda e: e.questions("latency_s"),
    "tokens_in": lambda e: e.questions("tokens_in"),
    "tokens_out": lambda e: e.questions("tokens_out"),
    "questions": lambda e: len({d["step"] for d in e.counted if "confirmed_by" not in d}),
    "decisions": lambda e: len(e.counted),
    "unreadable": lambda e: len([d for d in e.counted if not d["action"]]),
    "refused": lambda e: len([d for d in e.counted if not d["action"] and d["finish"] in ("refusal", "filtered")]),
    "cut_off": lambda e: len([d for d in e.counted if not d["action"] and d["finish"] == "length"]),
    "median_latency_s": lambda e: middle(e.questions("latency_s")),
    "rate_hz_5": lambda e: share_of(e.questions("rate_hz"), 0.05),
    "rate_hz_50": lambda e: middle(e.questions("rate_hz")),
    "rate_hz_95": lambda e: share_of(e.questions("rate_hz"), 0.95),
    "all_tokens_in": lambda e: total(e.questions("tokens_in")),
    "all_tokens_out": lambda e: total(e.questions("tokens_out")),
    "on_target": lambda e: e.every(lambda d: on_target(e, d)),
    "pointing_error_deg": lambda e: e.every(lambda d: angle(e, d)),
    "depth_error_m": lambda e: e.every(lambda d: depth(e, d)),
    "depth_error_abs_m": lambda e: e.every(lambda d: None if depth(e, d) is None else abs(depth(e, d))),
    "rescaled": rescaled,
    "wide_rotation": wide,
    "on_target_share": lambda e: average(e.every(lambda d: on_target(e, d))),
    "median_pointing_error_deg": lambda e: middle(e.every(lambda d: angle(e, d))),
    "median_depth_error_m": lambda e: middle(e.every(lambda d: depth(e, d))),
    "median_depth_error_abs_m": lambda e: middle(abs(v) for v in numbers(e.every(lambda d: depth(e, d)))),
    "rescaled_share": lambda e: average(rescaled(e)),
    "wide_rotations": lambda e: sum(v is True for v in wide(e)),
    "drones_found": count_drones("found"),
    "drones_beside": count_drones("beside"),
    "drones_elsewhere": count_drones("elsewhere"),
    "drones_silent": count_drones("silent"),
    "identical_share": commanding_metric("identical_share"),
    "one_candidate_share": one_candidate,
    "candidates_neared": commanding_metric("candidates_neared"),
    "spread_m": commanding_metric("spread_m"),
}
