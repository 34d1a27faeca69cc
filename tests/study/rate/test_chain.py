"""The times of a question. Every second of a step belongs to one link, for any agent and any start of the clock."""

from collections.abc import Callable

from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.models.model import Reply
from dronecats.study.rate.chain import ChainClock, QuestionTimes
from foundation.run_folder.rows import Decision

SPANS = st.lists(st.floats(0.0, 30.0), min_size=9, max_size=9)


class HandClock:
    """A clock that a test sets."""

    def __init__(self, now_s: float = 0.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s


def decision(step: int) -> Decision:
    return Decision(step=step, drone=0, frame_id=step + 5, t_frame=0.0, t_decided=1.0, action=None, rate_hz=0.5)


def through(begins_s: float, spans: list[float]) -> QuestionTimes:
    """Return the times of one question whose links take these spans."""
    wait, seen_tick, encoding, failed, model, unpacking, reply_tick, parsing, last_tick = spans
    clock, questions = HandClock(begins_s), list[QuestionTimes]()
    chain = ChainClock(clock, questions.append)

    def after(seconds: float, call: Callable[[], None]) -> None:
        clock.now_s += seconds
        call()

    chain.picture_requested()
    after(wait, lambda: chain.picture_arrived(0.25))
    after(seen_tick, chain.picture_seen)
    after(encoding + failed + model + unpacking, lambda: chain.answered(Reply("{}", model, waited_s=failed)))
    after(reply_tick, chain.ticked)
    after(parsing / 2, lambda: chain.decided(decision(3)))
    after(parsing / 2, chain.controller_done)
    assert questions == []
    after(last_tick, chain.setpoint_ready)
    (times,) = questions
    return times


@given(st.floats(0.0, 1e6), SPANS)
def test_link_times_are_separate_and_sum_to_the_step(begins_s, spans):
    times = through(begins_s, spans)
    wait, seen_tick, encoding, failed, model, unpacking, reply_tick, parsing, last_tick = spans
    near = 1e-5  # rounding to µs, and the resolution of a clock at so many seconds
    assert abs(times.wait_s - wait) < near
    assert abs(times.encode_s - (encoding + unpacking)) < near
    assert abs(times.failed_s - failed) < near
    assert abs(times.model_s - model) < near
    assert abs(times.parse_s - parsing) < near
    assert abs(times.tick_s - (seen_tick + reply_tick + last_tick)) < near
    assert abs(times.step_s - sum(spans)) < near
    assert abs(times.latency_s - (encoding + unpacking + model + parsing)) < near
    assert (times.step, times.frame_id, times.age_s, times.rate_hz) == (3, 8, 0.25, 0.5)


def test_the_next_picture_may_be_requested_before_the_setpoint_is_ready():
    """The steady agent does this: it continues to fly during a question."""
    clock, questions = HandClock(), list[QuestionTimes]()
    chain = ChainClock(clock, questions.append)
    for step in (0, 1):
        chain.picture_requested()
        chain.setpoint_ready()  # of the previous action, which is still streamed
        clock.now_s += 1.0
        chain.picture_arrived(0.0)
        chain.picture_seen()
        chain.answered(Reply("{}", 0.0))
        chain.decided(decision(step))
        chain.setpoint_ready()  # still of the previous action
        chain.controller_done()
        clock.now_s += 0.25
        chain.controller_done()  # the controller continues to run
    chain.picture_requested()
    chain.setpoint_ready()
    assert [(question.step, question.step_s, question.tick_s) for question in questions] == [
        (0, 1.25, 0.25),
        (1, 1.25, 0.25),
    ]


def test_a_question_without_a_setpoint_is_not_recorded():
    questions = list[QuestionTimes]()
    chain = ChainClock(HandClock(), questions.append)
    chain.picture_requested()
    chain.picture_arrived(0.0)
    chain.picture_seen()
    chain.controller_done()
    chain.setpoint_ready()  # of the hold during the question
    chain.picture_requested()  # the model failed, so a new picture is requested
    chain.setpoint_ready()
    assert questions == []
