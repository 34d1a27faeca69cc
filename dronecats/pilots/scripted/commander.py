"""A scripted commander: it divides what looks alike over its drones, from left to right, and believes every report.

No model, and it looks at no picture. All that it knows it reads in the question: the command, and of each drone its
goal, its report, and whether it has stalled. So equal questions get equal answers.
"""

import json
import re

from dronecats.pilots import briefing
from dronecats.pilots.scripted import places

ALIKE = 4  # things that look alike, in every commanding episode
_DRONE = re.compile(r"^Drone (\d+)$")
_STALLED = re.compile(r"^Drone (\d+) has not moved\b", re.MULTILINE)


def divide(prompt: str, images: list[bytes]) -> str:
    """Return the orders: a place from the left for every drone that has none, and the next free one for who stalls."""
    command = briefing.read(prompt).command
    goals, waiting = read(prompt)
    stalled = {int(number) for number in _STALLED.findall(prompt)}
    taken = {place for goal in goals.values() if (place := places.told(goal)) is not None}
    orders = []
    for drone, goal in goals.items():
        place = places.told(goal)
        if place is None:
            place = (drone - 1) % ALIKE + 1
        elif drone in stalled:
            coming = [(place + k) % ALIKE + 1 for k in range(ALIKE)]
            place = next((one for one in coming if one not in taken), coming[0])
        else:
            continue
        taken.add(place)
        orders.append({"drone": drone, "goal": places.goal(command, place)})
    return json.dumps({"orders": orders, "confirm": waiting})


def read(prompt: str) -> tuple[dict[int, str], list[int]]:
    """Return the goal of each drone in the roster by its number, and the numbers of those that wait with a report."""
    goals: dict[int, str] = {}
    waiting: list[int] = []
    drone = 0
    for line in prompt.splitlines():
        if named := _DRONE.match(line):
            drone = int(named[1])
        elif drone and line.startswith("- goal,"):
            goals[drone] = line.partition(": ")[2]
        elif drone and line.startswith("- report: says that it has arrived"):
            waiting.append(drone)
    return goals, waiting
