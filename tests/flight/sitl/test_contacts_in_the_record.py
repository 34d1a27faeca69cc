"""What a drone flies into stands in truth.jsonl and in the metrics, as the physics have it."""

import pytest

from dronecats.flight.logger.recorder import Recorder
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.judging import METRICS
from foundation.camera import CameraModel
from foundation.measurement import TargetMeasurement
from foundation.run_folder.reading import read
from foundation.truth import SaidHit, clear_text, hit_of, hit_text, seconds_of
from tests.flight.sitl.before_a_wall import flying, stream

ORIGIN = (47.4, 8.5, 488.0)
NOTHING = TargetMeasurement(target_ned=(0.0, 0.0, 0.0), distance_m=50.0, visible=False)
HITS = (SaidHit("house-25", 1.2, False), SaidHit("another drone", 0.0, True), SaidHit("the ground", None, True))


@pytest.mark.parametrize("hit", HITS, ids=lambda hit: hit.what)
def test_a_hit_is_read_back(hit):
    assert hit_of(hit_text(hit)) == hit
    assert seconds_of(hit_text(hit)) is None


def test_a_long_name_fits_into_a_message():
    text = hit_text(SaidHit("x" * 80, 12.3, True))
    assert len(text) == 50
    accented = hit_text(SaidHit("é" * 40, 12.3, True))
    assert len(accented.encode()) <= 50
    assert accented.endswith(" at 12.3 m/s")
    assert hit_of(text) == SaidHit(text[11:].partition(" at ")[0], 12.3, True)
    assert seconds_of(clear_text(7.25)) == 7.25
    assert hit_of("Collision of interests") is None


def test_a_press_stands_in_the_record(tmp_path):
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
    flown = JudgedFlight.read(tmp_path)
    assert METRICS["hits"].of(flown) == len(logs.hits)
    assert METRICS["crashes"].of(flown) == int(vehicle.plant.state["crashed"])
    assert METRICS["hardest_hit_mps"].of(flown) == max(each.closing_speed or 0.0 for each in logs.hits)
    seconds = METRICS["contact_s"].of(flown)
    assert seconds == pytest.approx(sum(each.contact_s for each in logs.clears), abs=0.02)
    assert isinstance(seconds, float)
    assert 0.0 < seconds <= (last_us - first_us) / 1e6 + 0.02
