"""Random flights of one to three drones, as log rows and as a JudgedFlight. Times are multiples of 1/16 s."""

import math
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from dronecats.judge.judged_flight import JudgedFlight
from tests.judge.episode_logs import decision, frame, logs, pose

CAP_S = 30.0  # cap of these flights
TICK_S = 1 / 16
RECORD = {
    "cell": "commanding",
    "target": {"position_ned": [20.0, 0.0, 0.5]},
    "candidates": [{"position_ned": [20.0, 8.0, 0.5]}, {"position_ned": [20.0, -8.0, 0.5]}],
}
TARGET = [20.0, 0.0, -0.5]
BEGIN = {"kind": "begin", "t": 0.0, "t0_us": 5, "cap_s": CAP_S, "contacts": True, "resets": True}

number = st.integers(0, 1000).map(float) | st.sampled_from([0.0, 100.0, 128.0, 164.0, 72.0, 52.0, 500.0])
go = st.builds(
    lambda x, y, depth_m: {"action": "go", "point": [x, y], "depth_m": depth_m},
    number, number, st.sampled_from([0.5, 1.9, 2.0, 4.0, 5.0, 12.5]),
)  # fmt: skip
rotate = st.sampled_from([-120.0, -90.0, 45, 90.0, 90.5, 360]).map(lambda a: {"action": "rotate", "angle_deg": a})
action = st.one_of(
    go, go, go, rotate, st.just({"action": "think"}), st.just({"action": "finished"}), st.just({"action": "finished"}),
    st.none(),
)  # fmt: skip
maybe = st.sampled_from([True, True, True, False])
place = st.tuples(st.sampled_from([0.0, 14.0, 17.0, 19.0]), st.sampled_from([0.0, 2.0, 8.0, -6.0]), st.just(-1.5))
known_frd = st.tuples(st.integers(-5, 20).map(float), st.integers(-9, 9).map(float), st.integers(-4, 4).map(float))
box = st.tuples(*[st.sampled_from([0.0, 100.0, 300.0, 480.0])] * 2, *[st.sampled_from([500.0, 700.0, 1000.0])] * 2)


def away(here: tuple[float, float, float]) -> float:
    """Return the distance (m) of a position from the target, rounded as in the logs."""
    return round(math.dist(here, TARGET), 4)


@st.composite
def contacts(draw: Any, drone: int) -> list[dict[str, Any]]:
    """Draw the rows of a drone's successive contacts. The last contact may not have ended."""
    rows, at = [], draw(st.sampled_from([0.0, 3.0, 12.0]))
    for last in [False] * draw(st.integers(0, 2)) + [True]:
        length = draw(st.sampled_from([0.0, 0.25, 9.0]))
        for k in range(draw(st.integers(1, 2))):
            speed, crash = draw(st.sampled_from([None, 0.5, 1.2])), draw(st.booleans())
            rows.append({"kind": "hit", "t": at + k * TICK_S * (length > 0), "drone": drone, "what": f"thing-{k}",
                         "closing_speed": speed, "crash": crash})  # fmt: skip
        if not last or draw(st.booleans()):
            rows.append({"kind": "clear", "t": at + length + 0.5, "drone": drone, "contact_s": length})
        at += length + 1.0
    return rows if draw(st.booleans()) else []


@st.composite
def resets(draw: Any, drone: int) -> list[dict[str, Any]]:
    """Draw the rows of a drone's estimator resets. Some of them are after the cap."""
    times = draw(st.lists(st.sampled_from([0.5, 7.0, 29.0, 31.0]), max_size=2))
    return [
        {"kind": "reset", "t": t, "drone": drone, "count": draw(st.integers(1, 3)), "quantities": ["yaw"],
         "yaw_deg": -87.0, "position_m": 0.0, "height_m": 0.0, "velocity_mps": 0.0}
        for t in times
    ]  # fmt: skip


@st.composite
def flights(draw: Any) -> tuple[list[dict[str, Any]], list[dict[str, Any]], dict[str, Any] | None]:
    """Draw a flight as (decisions, truth, record)."""
    drones, commanding, is_complete = draw(st.integers(1, 3)), draw(st.booleans()), draw(maybe)
    decisions, truth = [], [BEGIN]
    t = 0.0
    for step in range(draw(st.integers(0, 8))):
        t += draw(st.sampled_from([1.0, 2.5, 2.5, 6.0]))
        costs = {
            "latency_s": draw(st.sampled_from([None, 0.5, 0.75])), "tokens_in": draw(st.sampled_from([None, 100, 250])),
            "tokens_out": draw(st.sampled_from([None, 5, 9])), "rate_hz": draw(st.sampled_from([None, 0.4, 0.5, 2.0])),
            "finish": draw(st.sampled_from(["length", "refusal", "filtered", "eos"])),
        }  # fmt: skip
        for drone in range(drones):
            drawn_action = draw(action)
            decisions.append({**decision(step, 10 * step + drone, t, None, drone), **costs, "action": drawn_action})
            seen = draw(st.booleans() if is_complete else st.sampled_from([True, False, None]))
            here = draw(place)
            row = frame(
                10 * step + drone, t - (0.5 if is_complete or draw(maybe) else 0.75), away(here), seen, drone,
                position_ned=here, target_ned=TARGET,
                bearing_deg=draw(st.sampled_from([0.0, 44.0, 46.0, -45.0, 170.0])),
                distance_box_m=draw(st.none() | st.integers(0, 9).map(float)),
                oracle_depth_m=draw(st.sampled_from([2.0, 9.0])) if seen else None,
                target_frd=draw(st.none() | known_frd), target_box=draw(st.none() | box),
            )  # fmt: skip
            if is_complete or draw(maybe):
                truth.append(row)
    for drone in range(drones):
        at = 0.0
        for where, seen, yaw_deg in draw(
            st.lists(st.tuples(place, st.booleans(), st.sampled_from([0.0, 90.0, 179.0, -170.0])), max_size=8)
        ):
            truth.append(pose(at, away(where), seen, drone, list(where), yaw_deg=yaw_deg, target_ned=TARGET))
            at += draw(st.sampled_from([0.5, 0.5, 1.0]))
    for drone in range(drones):
        truth += draw(contacts(drone)) + draw(resets(drone))
    record = {**RECORD, "cell": "commanding" if commanding else "approaching"} if draw(maybe) else None
    return decisions, truth, record


def judged_flight(
    rows: tuple[list[dict[str, Any]], list[dict[str, Any]], dict[str, Any] | None], end: Any
) -> JudgedFlight:
    """Return the JudgedFlight with these rows."""
    decisions, truth, record = rows
    flight_logs = logs(decisions, truth, begin=BEGIN, end=end, record=record)
    return JudgedFlight(Path("somewhere"), {"id": "e", **(record or {})}, flight_logs, 5.0, CAP_S)
