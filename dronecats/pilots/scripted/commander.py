"""A scripted commander: it divides the candidates over its drones, from left to right, and believes every report.

It is no model and looks at no picture. It reads the command and each drone's goal, report and stall in the question, so
equal questions get equal answers. A goal names a candidate by its place from the left; the oracle reads it here, too.
"""

import json
import re

from dronecats.pilots import actions

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
_PLACE = re.compile(rf"look at the ({'|'.join(ORDINALS)}) one from the left\b", re.IGNORECASE)
CANDIDATES = 4  # things that look alike in every commanding episode
_DRONE = re.compile(r"^Drone (\d+)$")
_STALLED = re.compile(r"^Drone (\d+) has not moved\b", re.MULTILINE)


def goal_text(command: str, place: int) -> str:
    """Return the goal of a drone: the command, and one candidate by its place from the left, from 1."""
    return f"{command}: look at the {ORDINALS[place - 1]} one from the left"


def place_in_goal(command: str) -> int | None:
    """Return the candidate's place from the left in a goal, from 1; None if it has none."""
    match = _PLACE.search(command)
    return ORDINALS.index(match[1].lower()) + 1 if match else None


def divide(prompt: str, images: list[bytes]) -> str:
    """Return the orders: a place for every drone without one, and the next free place for every stalled drone."""
    command = actions.read_prompt(prompt).command
    goals, waiting = read_roster(prompt)
    stalled = {int(number) for number in _STALLED.findall(prompt)}
    taken = {place for goal in goals.values() if (place := place_in_goal(goal)) is not None}
    orders = []
    for drone, goal in goals.items():
        place = place_in_goal(goal)
        if place is None:
            place = (drone - 1) % CANDIDATES + 1
        elif drone in stalled:
            next_places = [(place + k) % CANDIDATES + 1 for k in range(CANDIDATES)]
            place = next((p for p in next_places if p not in taken), next_places[0])
        else:
            continue
        taken.add(place)
        orders.append({"drone": drone, "goal": goal_text(command, place)})
    return json.dumps({"orders": orders, "confirm": waiting})


def read_roster(prompt: str) -> tuple[dict[int, str], list[int]]:
    """Return the goal of each drone of the question by its number, and the numbers of drones with a waiting report."""
    goals: dict[int, str] = {}
    waiting: list[int] = []
    drone = 0
    for line in prompt.splitlines():
        if heading := _DRONE.match(line):
            drone = int(heading[1])
        elif drone and line.startswith("- goal,"):
            goals[drone] = line.partition(": ")[2]
        elif drone and line.startswith("- report: says that it has arrived"):
            waiting.append(drone)
    return goals, waiting
