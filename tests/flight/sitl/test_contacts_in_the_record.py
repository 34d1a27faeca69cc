"""Contacts of a drone appear in truth.jsonl and in the metrics as the physics computed them."""

import json

import pytest

from dronecats.flight.logger.recorder import Recorder
from dronecats.flight.sitl.collisions import CollisionReport
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.judging import METRICS
from foundation.camera import CameraModel
from foundation.mavlink import Packer, dialect
from foundation.measurement import TargetMeasurement
from foundation.run_folder import layout
from foundation.run_folder.reading import read
from foundation.truth import TRUTH_COMPONENT, HitReport, clear_text, hit_of, hit_text, seconds_of
from tests.flight.sitl.before_a_wall import WALL_M, flying, stream, wall
from tests.vehicles import fleet
from vehicles.collision import HIT_LEAST

ORIGIN = (47.4, 8.5, 488.0)
NOTHING = TargetMeasurement(target_ned=(0.0, 0.0, 0.0), distance_m=50.0, visible=False)
HITS = (HitReport("house-25", 1.2, False), HitReport("another drone", 0.0, True), HitReport("the ground", None, True))


@pytest.mark.parametrize("hit", HITS, ids=lambda hit: hit.what)
def test_a_hit_round_trips_through_its_text(hit):
    assert hit_of(hit_text(hit)) == hit
    assert seconds_of(hit_text(hit)) is None


def test_a_long_name_fits_into_a_message():
    text = hit_text(HitReport("x" * 80, 12.3, True))
    assert len(text) == 50
    accented = hit_text(HitReport("é" * 40, 12.3, True))
    assert len(accented.encode()) <= 50
    assert accented.endswith(" at 12.3 m/s")
    assert hit_of(text) == HitReport(text[11:].partition(" at ")[0], 12.3, True)
    assert seconds_of(clear_text(7.25)) == 7.25
    assert hit_of("Collision of interests") is None


def test_an_obstacle_with_an_umlaut_keeps_its_name_in_the_record(tmp_path):
    recorder = Recorder(tmp_path, ORIGIN, lambda *_: NOTHING, CameraModel())
    recorder.begin(0, 300.0)
    text = hit_text(HitReport("Gebäude 3", 1.2, False)).encode()
    recorder.truth(Packer(1, TRUTH_COMPONENT).pack(dialect.MAVLink_statustext_message(2, text)))
    recorder.close()
    rows = [json.loads(line) for line in (tmp_path / layout.TRUTH).read_text(encoding="utf-8").splitlines()]
    assert [row["what"] for row in rows if "what" in row] == ["Gebäude 3"]


def test_hits_and_contact_time_of_a_press_are_recorded(tmp_path):
    vehicle = flying(1)
    recorder = Recorder(tmp_path, ORIGIN, lambda *_: NOTHING, CameraModel())
    begun_us = vehicle.time_us
    recorder.begin(begun_us, 300.0)
    (tmp_path / "decisions.jsonl").write_text("")
    first_us, first_speed, last_us = 0, 0.0, 0
    for tick in range(3600):
        if tick % 5 == 0:
            stream(vehicle, 1.2 if tick < 2800 else -1.2)
        vehicle.advance()
        recorder.truth(vehicle.truth() + vehicle.collisions())
        if vehicle.plant.state["hits"] and not first_us:
            first_us, first_speed = vehicle.time_us, float(vehicle.plant.state["hit_speed"])
        last_us = int(vehicle.plant.near["touched_us"].max())
    recorder.end("cap")
    recorder.close()
    logs = read(tmp_path)
    assert logs.hits[0].what == "wall"
    assert logs.hits[0].t == pytest.approx((first_us - begun_us) / 1e6, abs=0.03)
    assert logs.hits[0].closing_speed == pytest.approx(first_speed, abs=0.05)
    assert logs.clears[-1].t == pytest.approx((last_us - begun_us) / 1e6 + 0.5, abs=0.05)
    judged_flight = JudgedFlight.read(tmp_path)
    assert METRICS["hits"].of(judged_flight) == len(logs.hits)
    assert METRICS["crashes"].of(judged_flight) == int(vehicle.plant.state["crashed"])
    assert METRICS["hardest_hit_mps"].of(judged_flight) == max(hit.closing_speed or 0.0 for hit in logs.hits)
    seconds = METRICS["contact_s"].of(judged_flight)
    assert seconds == pytest.approx(sum(hit.contact_s for hit in logs.clears), abs=0.02)
    assert isinstance(seconds, float)
    assert 0.0 < seconds <= (last_us - first_us) / 1e6 + 0.02


def test_leaning_on_a_wall_is_recorded_after_it_has_lasted(tmp_path):
    """The vehicle touches the wall at 0.1 m/s, too slow for a hit, and leans on it for three seconds."""
    vehicle = flying(1, north=18.9)
    recorder = Recorder(tmp_path, ORIGIN, lambda *_: NOTHING, CameraModel())
    begun_us = vehicle.time_us
    recorder.begin(begun_us, 300.0)
    (tmp_path / "decisions.jsonl").write_text("")
    first_us = last_us = 0
    while not last_us or vehicle.time_us - last_us < 800_000:
        leant = first_us and vehicle.time_us - first_us > 3_000_000
        if (vehicle.time_us - begun_us) % 50_000 == 0:
            stream(vehicle, -0.5 if leant else 0.1)
        vehicle.advance()
        recorder.truth(vehicle.truth() + vehicle.collisions())
        touched_us = int(vehicle.plant.near["touched_us"].max())
        first_us, last_us = (first_us or touched_us, touched_us) if touched_us > 0 else (0, 0)
    recorder.end("cap")
    recorder.close()
    assert not vehicle.plant.state["hits"]
    logs = read(tmp_path)
    (hit,), (clear,) = logs.hits, logs.clears
    assert hit.what == "wall"
    assert hit.closing_speed is not None
    assert 0.0 <= hit.closing_speed <= HIT_LEAST
    assert not hit.crash
    assert hit.t == pytest.approx((first_us - begun_us) / 1e6 + 0.5, abs=0.2)
    assert clear.contact_s == pytest.approx((last_us - first_us) / 1e6, abs=0.05)


@pytest.mark.parametrize(("touch_s", "counts"), [(0.3, False), (0.7, True)])
def test_a_touch_without_a_hit_counts_only_if_it_lasts(touch_s, counts):
    craft = fleet.vehicle(obstacles=wall())
    report, texts = CollisionReport(craft), []
    for now_us in range(0, 2_000_000, 10_000):
        craft.state["time_us"] = now_us
        if now_us < touch_s * 1e6:
            craft.near["newest_us"] = craft.near["leant_us"] = now_us
        message = report.message()
        texts += [message.text] if message else []
    assert bool(texts) == counts
    if counts:
        begin, end = texts
        assert hit_of(begin) == HitReport("wall", 0.0, False)
        assert seconds_of(end) == pytest.approx(touch_s, abs=0.03)


def test_standing_on_the_ground_against_a_wall_is_not_a_contact():
    craft = fleet.vehicle(
        obstacles=wall(), camera_frd=CameraModel().offset_frd, position_ned=(WALL_M - 0.57, 0.0, -0.24)
    )
    report, touched = CollisionReport(craft), False
    for _ in range(200):
        craft.advance(10)
        touched = touched or bool(craft.state["on_ground"] and craft.near["newest_us"] > 0)
        assert report.message() is None
    assert touched
