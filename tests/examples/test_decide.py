"""The head turns its probabilities into a reply that the agent's parser reads."""

import numpy as np
import pytest

from dronecats.agent.action import Finished, Go, Rotate, Think
from dronecats.agent.reply.strict import parse
from examples.action_head.features import as_past
from examples.action_head.pilot import COLUMNS, ELSEWHERE_M, ROWS, TURNS_DEG, Outlook, decide, point


def outlook(go=0.0, rotate=0.0, finished=0.0, *, cell=(9, 16), depth_m=7.0, turn_deg=0.0):
    heat = np.zeros((ROWS, COLUMNS), np.float32)
    heat[cell] = 1.0
    turns = np.array([float(angle == turn_deg) for angle in TURNS_DEG], np.float32)
    return Outlook(np.array([go, rotate, 0.0, finished], np.float32), heat, depth_m, turns)


def test_a_go_reply_holds_the_point_and_the_depth():
    action = parse(decide(outlook(go=0.9, cell=(4, 24), depth_m=7.25), (), 0.5))
    assert isinstance(action, Go)
    assert action.x == pytest.approx(24.5 / 32 * 1000, abs=1)
    assert (action.y, action.depth_m) == (250.0, 7.25)


def test_a_point_is_the_centre_of_its_cell_even_in_the_corners():
    for cell in ((0, 0), (0, COLUMNS - 1), (ROWS - 1, 0), (ROWS - 1, COLUMNS - 1)):
        x, y = point(outlook(cell=cell).heat)
        assert x * COLUMNS == pytest.approx(cell[1] + 0.5), cell
        assert y * ROWS == pytest.approx(cell[0] + 0.5), cell


def test_a_point_lies_between_neighbouring_cells_that_share_the_probability():
    heat = outlook(cell=(9, 10)).heat
    heat[9, 11] = 1.0 / 3.0
    heat[2, 30] = 0.9  # a second, lower peak: the mean of both peaks would be an empty place
    assert point(heat)[0] * COLUMNS == pytest.approx(10.75)


def test_depths_are_clamped_to_a_plausible_range():
    for depth_m, named in ((0.0, 0.5), (1e9, 60.0), (float("inf"), 60.0)):
        action = parse(decide(outlook(go=1.0, depth_m=depth_m), (), 0.5))
        assert isinstance(action, Go), depth_m
        assert action.depth_m == named, depth_m


def test_the_head_turns_if_a_turn_is_more_probable_than_a_go():
    assert parse(decide(outlook(go=0.3, rotate=0.4, turn_deg=-75.0), (), 0.5)) == Rotate(-75.0)


def test_the_head_declares_at_or_above_the_threshold():
    assert parse(decide(outlook(go=0.75, finished=0.25), (), 0.25)) == Finished()
    assert isinstance(parse(decide(outlook(go=0.75, finished=0.24), (), 0.25)), Go)


def test_after_a_false_declaration_the_head_acts_first():
    past = [as_past(Finished())]
    assert isinstance(parse(decide(outlook(go=0.1, finished=0.9), past, 0.4)), Go)
    assert parse(decide(outlook(go=0.1, finished=0.9), [*past, as_past(Go(1.0, 2.0, 3.0))], 0.4)) == Finished()


def test_after_a_full_turn_the_head_moves_elsewhere():
    turned = [as_past(Rotate(75.0))] * 4 + [as_past(Think())]
    assert parse(decide(outlook(rotate=1.0), turned, 0.5)) == Go(500.0, 500.0, ELSEWHERE_M)
    assert isinstance(parse(decide(outlook(rotate=1.0), turned[1:], 0.5)), Rotate)
    assert isinstance(parse(decide(outlook(rotate=1.0), [as_past(Go(1.0, 2.0, 3.0)), *turned[1:]], 0.5)), Rotate)
