"""Late, lost, stale or rare images: which image a decider gets, and at which time of a simulated clock."""

import itertools
from collections import Counter
from typing import Any

import numpy as np
import pytest
from scipy import stats

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.latency import COMMANDER, LatencyPolicy, Question
from dronecats.agent.loop import Asker, Questions, Tally
from dronecats.agent.pictures import PicturePath
from dronecats.agent.prompt import Prompt
from foundation.camera import CameraModel, Frame
from foundation.errors import UsageError
from foundation.run_folder.writing import LineLog
from foundation.threads import InlineExecutor
from tests.agent.test_deciders import Noting

TICK_S = 0.05
GREY = np.zeros((1, 1, 3), np.uint8)


class Watch:
    """A clock, and a camera with an image for every past time. The episode begins at 2 s."""

    T0_US = 2_000_000

    def __init__(self):
        self.time_us = self.T0_US
        self.taken = 0

    def now_s(self):
        return (self.time_us - self.T0_US) / 1e6

    def newest(self, drone=0):
        return self.at(self.time_us, drone)

    def at(self, time_us, drone=0):
        assert time_us <= self.time_us
        self.taken += 1
        return Frame(self.taken, drone, time_us, GREY)

    def close(self):
        pass


def questions(tmp_path, count, *, drones=(0,), every_s=2.0, first=None, seed=(4, 2), cap_s=1e6, **faults):
    """Ask `count` questions, `every_s` apart; return (frames, time asked s, time received s) for each."""
    watch = Watch()
    cockpit = Cockpit(
        aircraft=[], camera=watch, camera_model=CameraModel(), log=LineLog(tmp_path / "decisions.jsonl"),
        frames_dir=tmp_path, executor=InlineExecutor(), t0_us=Watch.T0_US, seed=seed,
        pictures=PicturePath(**faults, recall=watch.at),
    )  # fmt: skip
    asked = Questions(Noting(), Prompt.load(), "go", LatencyPolicy.parse("fixed:0"))
    asker = Asker(asked, cockpit, watch.now_s, Tally())
    results: list[Any] = []
    for step in range(count):
        asked_s = watch.now_s()
        asker._questions_sent = step
        coming = asker._newest_frames(drones[0] if first is None else first, drones, cap_s)
        while True:
            try:
                next(coming)
            except StopIteration as came:
                frames = came.value
                break
            watch.time_us += 50_000
        results.append((frames, asked_s, watch.now_s()))
        watch.time_us = max(watch.time_us, Watch.T0_US + round((asked_s + every_s) * 1e6))
    cockpit.log.close()
    return results


def taken_s(frame):
    return (frame.time_us - Watch.T0_US) / 1e6


def test_a_delayed_image_arrives_later_and_keeps_its_capture_time(tmp_path):
    for frames, asked_s, had_s in questions(tmp_path, 20, delay_s=0.7):
        assert taken_s(frames[0]) == asked_s
        assert had_s - asked_s == pytest.approx(0.7, abs=TICK_S + 1e-6)


@pytest.mark.parametrize(("rate_hz", "delay_s"), [(2.0, 0.0), (0.4, 1.3), (30.0, 2.0)])
def test_with_a_frame_rate_the_newest_received_image_is_used_at_once(tmp_path, rate_hz, delay_s):
    period_s = 1.0 / rate_hz
    for frames, asked_s, had_s in questions(tmp_path, 30, rate_hz=rate_hz, delay_s=delay_s, every_s=1.85)[3:]:
        age_s = had_s - taken_s(frames[0])
        assert had_s == asked_s
        assert delay_s - 1e-6 <= age_s < delay_s + period_s + 1e-6
        assert taken_s(frames[0]) / period_s == pytest.approx(round(taken_s(frames[0]) / period_s), abs=1e-4)


def test_with_a_frame_rate_each_image_is_taken_once(tmp_path):
    results = questions(tmp_path, 20, rate_hz=0.2, every_s=1.0)
    assert [frames[0].frame_id for frames, *_ in results] == [1 + step // 5 for step in range(20)]


def test_the_first_question_waits_for_the_first_image(tmp_path):
    (frames, _, had_s), *_ = questions(tmp_path, 1, rate_hz=1.0, delay_s=1.5)
    assert taken_s(frames[0]) == 0.0
    assert had_s == pytest.approx(1.5, abs=TICK_S)


def test_the_stale_fraction_of_questions_gets_the_previous_image(tmp_path):
    results = questions(tmp_path, 600, stale=0.3)
    stale = [later[0][0] is before[0][0] for before, later in itertools.pairwise(results)]
    assert stats.binomtest(sum(stale), len(stale), 0.3).pvalue > 0.003
    assert all(had_s == asked_s for _, asked_s, had_s in results)
    assert {taken_s(frames[0]) for frames, *_ in questions(tmp_path, 9, stale=1.0)} == {0.0}


@pytest.mark.parametrize(("delay_s", "again_s"), [(0.0, 0.1), (0.5, 0.5)])
def test_the_dropped_fraction_of_images_is_lost_and_replaced_by_the_next(tmp_path, delay_s, again_s):
    results = questions(tmp_path, 500, dropped=0.25, delay_s=delay_s, every_s=60.0)
    lost = Counter(round((taken_s(frames[0]) - asked_s) / again_s) for frames, asked_s, _ in results)
    pictures = sum((count + 1) * times for count, times in lost.items())
    assert stats.binomtest(pictures - len(results), pictures, 0.25).pvalue > 0.003
    assert lost[1] > 0 < lost[2]
    for frames, _, had_s in results:
        assert had_s - taken_s(frames[0]) == pytest.approx(delay_s, abs=TICK_S + 1e-6)


def test_with_a_frame_rate_a_lost_image_is_replaced_by_the_next(tmp_path):
    results = questions(tmp_path, 400, dropped=0.3, rate_hz=0.5, every_s=61.0)
    late_s = {taken_s(frames[0]) - 2.0 * int(asked_s / 2.0) for frames, asked_s, _ in results}
    assert {0.0, 2.0, 4.0} <= {round(delay_s, 6) for delay_s in late_s}


def test_image_faults_depend_only_on_question_and_drone():
    few, many = PicturePath(stale=0.2, dropped=0.2), PicturePath(stale=0.6, dropped=0.6)
    all_questions = [
        Question((1, seed), step, first) for seed in (2, 3) for step in range(40) for first in (0, 1, COMMANDER)
    ]
    drawn = [[path.drawn(question, drone) for question in all_questions for drone in (0, 1)] for path in (few, many)]
    assert [few.drawn(question, drone) for question in all_questions for drone in (0, 1)] == drawn[0]
    assert all(more.stale >= less.stale and more.lost >= less.lost for less, more in zip(*drawn, strict=True))
    for part in (1, 2, 3, 6):  # drone, first drone of the question, step, flight
        halves = drawn[1][::2] if part == 1 else drawn[1]
        assert len({str(draw) for draw in halves}) > 2
    assert drawn[1][::2] != drawn[1][1::2]
    assert drawn[1][:240] != drawn[1][240:]
    assert drawn[1][0::6] != drawn[1][2::6] != drawn[1][4::6]


def test_each_drone_of_a_fleet_has_its_own_image_and_the_question_waits_for_all(tmp_path):
    results = questions(tmp_path, 60, drones=(0, 1, 2), dropped=0.5, every_s=30.0)
    assert any(len({frame.time_us for frame in frames}) > 1 for frames, *_ in results)
    for frames, _, had_s in results:
        assert [frame.drone for frame in frames] == [0, 1, 2]
        assert had_s == max(taken_s(frame) for frame in frames)


def test_there_is_no_image_after_the_end_of_the_episode(tmp_path):
    results = questions(tmp_path, 3, delay_s=4.0, cap_s=10.0)
    assert [frames is None for frames, *_ in results] == [False, False, True]
    assert results[-1][2] == pytest.approx(10.0, abs=TICK_S)


def test_impossible_camera_faults_are_rejected():
    from dronecats.flight.spec.disturbances import FrameFaults

    for wrong in ({"delay_s": -0.1}, {"dropped": 0.96}, {"stale": 1.1}, {"rate_hz": 0.0}, {"delay_s": float("nan")},
                  {"rate_hz": 0.1, "delay_s": 6.0}):  # fmt: skip
        with pytest.raises(UsageError):
            FrameFaults(**wrong)


def test_a_late_image_delays_only_its_own_question():
    """Deciders ask concurrently. A late image of one decider does not delay another decider."""
    watch = Watch()
    pictures = PicturePath(delay_s=1.0, recall=watch.at)

    def fetch(take):
        yield from ()
        return take()

    coming = [
        pictures.frames(watch, Question((1,), 0, drone), [drone], watch.now_s, 1e6, Watch.T0_US, fetch)
        for drone in (0, 1)
    ]
    ended_s: dict[int, float] = {}
    while len(ended_s) < len(coming):
        for drone, frames in enumerate(coming):
            if watch.now_s() >= 0.5 * drone and drone not in ended_s:
                try:
                    next(frames)
                except StopIteration:
                    ended_s[drone] = pictures.held_s[drone]
                    assert pictures.held_s[1 - drone] == ended_s.get(1 - drone, 0.0)
        watch.time_us += 50_000
    assert ended_s == {0: pytest.approx(1.0, abs=TICK_S), 1: pytest.approx(1.0, abs=TICK_S)}
