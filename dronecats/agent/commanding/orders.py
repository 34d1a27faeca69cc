"""What a commander may say, and the parser that reads it out of a reply: goals for drones, and reports confirmed."""

import json
from dataclasses import dataclass
from typing import Any

ORDERS, CONFIRM = "orders", "confirm"  # the keys of the reply's object
MAX_REPLY_CHARS = 50_000  # eight orders of the longest are far below this
MAX_TRIES = 200  # places in a reply at which its object may begin
MAX_VAIN_CHARS = 5 * MAX_REPLY_CHARS  # read in vain after such places
MAX_GOAL_CHARS = 500  # as an episode's own instruction


@dataclass(frozen=True, slots=True)
class FleetOrders:
    """One reply. Drones are counted from 0 here, and from 1 in the reply."""

    goals: tuple[tuple[int, str], ...] = ()  # (drone, its goal on one line), in the order of the reply
    confirmed: tuple[int, ...] = ()  # drones whose report is confirmed


class OrdersError(ValueError):
    """A reply holds no orders; the text says why. A failure of the commander, never of the infrastructure."""


def parse_orders(reply: str, drones: int) -> FleetOrders:
    """Return the orders in a commander's reply to a fleet of `drones`.

    Prose or a code fence around the object is tolerated: the last one that has either key counts, since what comes
    before leads up to it. Raises OrdersError when there is none, or when anything in it is malformed: half an order is
    none.
    """
    found = [value for value in _objects(reply) if ORDERS in value or CONFIRM in value]
    if not found:
        raise OrdersError(f'no JSON object with "{ORDERS}" or "{CONFIRM}" in the reply')
    goals = tuple(_goal(order, drones) for order in _list(found[-1], ORDERS))
    confirmed = tuple(_drone(number, drones) for number in _list(found[-1], CONFIRM))
    for drone in {drone for drone, _ in goals}:
        if sum(one == drone for one, _ in goals) > 1:
            raise OrdersError(f"drone {drone + 1} has two goals")
    return FleetOrders(goals, tuple(dict.fromkeys(confirmed)))


def _list(value: dict[str, Any], key: str) -> list[Any]:
    items = value.get(key, [])
    if not isinstance(items, list):
        raise OrdersError(f'"{key}" is not a list')
    return items


def _goal(order: Any, drones: int) -> tuple[int, str]:
    if not isinstance(order, dict):
        raise OrdersError("an order is not a JSON object")
    goal = order.get("goal")
    if not isinstance(goal, str):
        raise OrdersError('an order has no "goal" in words')
    line = " ".join(goal.split())  # it becomes a line of a prompt
    if not line or len(line) > MAX_GOAL_CHARS or not line.isprintable():
        raise OrdersError(f"a goal must be 1 … {MAX_GOAL_CHARS} printable characters")
    return _drone(order.get("drone"), drones), line


def _drone(number: Any, drones: int) -> int:
    if isinstance(number, bool) or not isinstance(number, int):
        raise OrdersError("a drone is not named by its number")
    if not 1 <= number <= drones:
        raise OrdersError(f"there is no drone {str(number)[:20]}, but 1 to {drones}")
    return number - 1


def _objects(reply: str) -> list[dict[str, Any]]:
    """Return the outermost JSON objects of the text, in order; what is read in vain is counted and bounded."""
    decoder = json.JSONDecoder()
    text, found, at, tries, vain = reply[:MAX_REPLY_CHARS], [], 0, 0, 0
    while vain < MAX_VAIN_CHARS and (at := text.find("{", at)) >= 0 and (tries := tries + 1) <= MAX_TRIES:
        try:
            value, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError) as error:  # only a JSONDecodeError says how far it came
            vain += (error.pos if isinstance(error, json.JSONDecodeError) else len(text)) - at
            at += 1
            continue
        found.append(value)
        at = end
    return found
