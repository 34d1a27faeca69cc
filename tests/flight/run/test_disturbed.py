"""Complete flights with disturbances: equal starts, repeats with the same bytes, and a reason for each failure."""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.disturbances import Disturbances, LinkFaults, VehicleFaults
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_json, from_json
from foundation.errors import UsageError
from hil.impairment import Impairment
from tests.support.json_lines import rows

LOSSY = Impairment(loss=0.3, delay_s=0.2, jitter_s=0.1, duplicate=0.1, reorder=0.1)
BAD = LinkFaults(to_vehicle=LOSSY, from_vehicle=LOSSY)
ROUGH = VehicleFaults(wind_ned=(4.0, 2.0, 0.0), gusts_w20=7.7, gps_noise=2.0, gps_delay_s=0.1, estimator_noise=2.0)

# the result, the rows of the truth, and the hash of all logs
Flight = tuple[dict[str, Any], list[dict[str, Any]], str]


def spec(disturbances: Disturbances, **changes: Any) -> FlightSpec:
    return FlightSpec(
        episode="residential-approaching-01",
        pilot="oracle",
        simulated=Simulated(speed=None, rendered=False),
        latency=LatencyPolicy.parse("fixed:0.5"),
        disturbances=disturbances,
        **changes,
    )


def fly_disturbed(folder: Path, disturbances: Disturbances, **changes: Any) -> Flight:
    result = fly(spec(disturbances, **changes), folder, lambda line: None)
    logs = [Path(result["run_dir"]) / name for name in ("truth.jsonl", "decisions.jsonl", "verdict.json")]
    return result, list(rows(logs[0])), hashlib.sha256(b"".join(log.read_bytes() for log in logs)).hexdigest()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return fly_disturbed(tmp_path_factory.mktemp("calm"), Disturbances())


def test_a_disturbed_flight_repeats_to_the_same_bytes(tmp_path: Path) -> None:
    rough = Disturbances(link=BAD, vehicle=ROUGH)
    first, again, calm = (
        fly_disturbed(tmp_path / name, how, seconds=6.0, full=True)[2]
        for name, how in (("first", rough), ("again", rough), ("calm", Disturbances()))
    )
    assert first == again != calm


def test_a_disturbed_flight_begins_at_the_same_time_and_place(undisturbed: Flight, tmp_path: Path) -> None:
    calm, true, _ = undisturbed
    first, disturbed, _ = fly_disturbed(tmp_path / "first", Disturbances(link=BAD, vehicle=ROUGH))
    assert calm["success"]
    assert first["success"]
    begins = [next(row for row in each if row["kind"] == "begin")["t0_us"] for each in (true, disturbed)]
    assert begins[0] == begins[1]
    places = [next(row for row in each if row.get("position_ned"))["position_ned"] for each in (true, disturbed)]
    # no setpoint arrives during the 0.2 s delay, while the wind moves the vehicle
    assert places[0] == pytest.approx(places[1], abs=0.1)


def test_late_telemetry_does_not_delay_every_question(undisturbed: Flight, tmp_path: Path) -> None:
    """If the agent took its newest telemetry as current, it would ask each question one delay after the picture."""
    late = Disturbances(link=LinkFaults(from_vehicle=Impairment(delay_s=1.0)))
    calm, _, _ = undisturbed
    result, _, _ = fly_disturbed(tmp_path / "late", late)
    assert result["steps"] == calm["steps"] == 6
    assert 1.0 <= result["sim_seconds"] - calm["sim_seconds"] < 3.0  # once, until the first message


def test_a_vehicle_without_setpoints_descends_by_its_failsafe_and_fails(tmp_path: Path) -> None:
    cut = Disturbances(link=LinkFaults(to_vehicle=Impairment(loss=1.0)))
    result, true, _ = fly_disturbed(tmp_path / "cut", cut, seconds=15.0)
    assert (result["outcome"], result["reason"], result["status"]) == ("failure", "cap", 0)
    heights = [-row["position_ned"][2] for row in true if row["kind"] == "pose"]
    assert heights[-1] < heights[0] - 1.0


def test_sparse_messages_are_not_reported_as_a_lost_link_or_a_takeover(tmp_path: Path) -> None:
    worst = Impairment(loss=0.95, delay_s=1.0)
    result, _, _ = fly_disturbed(
        tmp_path / "worst", Disturbances(link=LinkFaults(to_vehicle=worst, from_vehicle=worst)), seconds=20.0
    )
    assert (result["outcome"], result["reason"], result["status"]) == ("failure", "cap", 0)


def test_a_disturbed_flight_spec_round_trips_through_its_json_form() -> None:
    value = spec(Disturbances(link=BAD, vehicle=ROUGH))
    assert from_json(as_json(value), "here") == value


def test_invalid_disturbed_flights_are_rejected_before_anything_starts() -> None:
    with pytest.raises(UsageError, match=r"0\.8 kg"):
        look_up(spec(Disturbances(vehicle=VehicleFaults(payload_kg=0.8))))
    with pytest.raises(UsageError, match=r"host-stalls .*--speed"):
        spec(Disturbances(vehicle=VehicleFaults(stalled=0.1)))
    six = replace(spec(Disturbances()), simulated=Simulated(airframe="hexa", autopilot="px4"))
    with pytest.raises(UsageError, match=r"hexa.* 6 "):
        look_up(six)
