"""Tests the scripted commander and the prompts that the agent sends to it."""

import json
import re

from dronecats.agent.action import Finished, Go
from dronecats.agent.commanding.command_prompt import CommandedDrone, CommandPrompt, roster
from dronecats.agent.controller import Drone
from dronecats.pilots import scripted as commander
from foundation.camera import CameraModel
from foundation.run_folder.rows import Cause
from tests.agent.flown_wire import Clock

COMMAND = "Find the red car with the plate 4017: hurry"
START = (Cause(why="start"),)


def posts(count):
    return [CommandedDrone(Drone(k, Clock(), CameraModel()), COMMAND) for k in range(count)]


def ask(fleet, causes, now_s=20.0):
    prompt = CommandPrompt.load().render(COMMAND, roster(fleet, now_s), causes, len(fleet))
    reply = json.loads(commander.scripted_orders(prompt, []))
    for order in reply["orders"]:
        fleet[order["drone"] - 1].order(order["goal"], now_s)
        fleet[order["drone"] - 1].begun = True
    return {order["drone"]: commander.place_in_goal(order["goal"]) for order in reply["orders"]}, reply["confirm"]


def test_drones_get_places_from_the_left():
    for count, places in ((1, [1]), (2, [1, 2]), (4, [1, 2, 3, 4]), (6, [1, 2, 3, 4, 1, 2])):
        fleet = posts(count)
        assert ask(fleet, START) == (dict(enumerate(places, 1)), [])
        assert [post.goal for post in fleet] == [commander.goal_text(COMMAND, place) for place in places]
        assert ask(fleet, (Cause(why="time"),)) == ({}, [])  # every drone keeps its place


def test_a_stalled_drone_gets_the_next_free_place():
    fleet = posts(2)
    ask(fleet, START)
    assert ask(fleet, (Cause(why="stall", drone=0),)) == ({1: 3}, [])
    assert ask(fleet, (Cause(why="stall", drone=1), Cause(why="stall", drone=0))) == ({1: 4, 2: 1}, [])


def test_all_reports_and_nothing_else_are_confirmed():
    fleet = posts(4)
    ask(fleet, START)
    for drone in (1, 3):
        fleet[drone].drone.history.append(Finished())
        fleet[drone].note(False, True, 18.0)
    assert ask(fleet, (Cause(why="report", drone=1),)) == ({}, [2, 4])


def test_the_roster_has_the_order_and_the_actions_of_each_drone():
    fleet = posts(2)
    fleet[0].begun, fleet[1].begun = True, True
    fleet[0].order("look at the left one", 5.0)
    fleet[0].drone.history.append(Go(100, 500, 12.5))
    fleet[0].note(True, False, 8.0)
    text = roster(fleet, 20.0)
    first, second = text.split("\n\n")
    assert re.search(r"\b15 s .*\b1 .*look at the left one", first)
    assert re.search(r"\bleft\b.*12\.5 m", first)
    assert "GO x=128 y=360 depth=12.5m" in first
    assert COMMAND in second
    assert "12.5 m" not in second


def test_a_goal_text_is_parsed_back_to_its_place():
    assert [commander.place_in_goal(commander.goal_text(COMMAND, place)) for place in range(1, 9)] == list(range(1, 9))
    for command in ("", "look at the car", "look at the ninth one from the left", "the first one from the left"):
        assert commander.place_in_goal(command) is None
