"""The lines that a flight prints about its decisions."""

import pytest

from dronecats.flight.run.progress import UNREADABLE, StepLines
from foundation.errors import UnreadableError
from foundation.run_folder.rows import Decision

GO = {"action": "go", "point": [463, 553], "depth_m": 15.0}


def decision(step=0, drone=0, **fields):
    values = {"action": None, "error": "no JSON object in the reply", "tokens_out": 8192, **fields}
    return Decision(step=step, drone=drone, frame_id=step, t_frame=1.0, t_decided=2.0, reply="", latency_s=0.5,
                    tokens_in=10, thinking=False, rate_hz=None, **values)  # fmt: skip


def printed(decisions, drones=1, stop_unreadable=None):
    lines: list[str] = []
    show = StepLines(lines.append, drones, stop_unreadable=stop_unreadable)
    for each in decisions:
        show(each)
    return lines


def test_a_point_is_printed_as_in_the_reply():
    (line,) = printed([decision(action=GO, error=None)])
    assert "463, 553" in line


def test_drones_are_numbered_from_one_and_a_single_drone_has_no_number():
    assert ["drone" in line for line in printed([decision()])] == [False]
    lines = printed([decision(drone=drone) for drone in range(4)], drones=4)
    assert [f"drone {n}" in line for n, line in enumerate(lines, 1)] == [True] * 4


@pytest.mark.parametrize(
    ("finish", "tokens_out", "words"),
    [
        ("length", 8192, ["8,192", "max_tokens"]),
        ("length", None, ["max_tokens"]),
        ("refusal", 3, ["refused"]),
        ("filtered", 0, ["filter"]),
        ("another", 3, ["no JSON object"]),
    ],
)
def test_the_servers_finish_reason_explains_an_unreadable_reply(finish, tokens_out, words):
    (line,) = printed([decision(finish=finish, tokens_out=tokens_out)])
    assert all(word in line for word in words)


def test_many_unreadable_replies_in_a_row_cause_one_warning():
    unread = [decision(step, finish="length") for step in range(3 * UNREADABLE)]
    warnings = [line for line in printed(unread) if "WARNING" in line]
    assert len(warnings) == 1
    assert "8,192" in warnings[0]
    unread[UNREADABLE // 2 :: UNREADABLE // 2] = [
        decision(action=GO, error=None) for _ in unread[UNREADABLE // 2 :: UNREADABLE // 2]
    ]
    assert not [line for line in printed(unread) if "WARNING" in line]


def test_stop_unreadable_ends_the_flight_after_that_many_unreadable_replies_in_a_row():
    unread = [decision(step, finish="length") for step in range(3)]
    readable = decision(action=GO, error=None)
    with pytest.raises(UnreadableError, match="8,192 tokens"):
        printed(unread, stop_unreadable=3)
    printed([*unread[:2], readable, *unread[:2]], stop_unreadable=3)
    of_two_drones = [decision(step, drone) for step in range(2) for drone in range(2)]
    printed(of_two_drones, drones=2, stop_unreadable=3)  # replies are counted per drone
    printed(unread * 9)
