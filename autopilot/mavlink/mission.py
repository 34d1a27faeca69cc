"""MAVLink's mission protocol for missions, geofences and rally points: upload, download, clearing, the current item.

A download reads each item from the present plan and keeps no state. An upload replaces the plan only when it is
complete. Each client has its own uploads, so clients do not disturb each other.
Source: mavlink.io/en/services/mission.html.
"""

import math

from autopilot.commander import plans
from autopilot.commander.plans import CAPACITY, GLOBAL_FRAMES, KINDS, MISSION, NO_COORDINATE, PlanItem
from autopilot.mavlink.node import BY_NAME, CANCELLED, Key, Node, Port, Upload, sender
from autopilot.mavlink.status_makers import Message
from foundation.mavlink import dialect

ACCEPTED, UNSUPPORTED = int(dialect.MAV_MISSION_ACCEPTED), int(dialect.MAV_MISSION_UNSUPPORTED)
NO_SPACE, INVALID_SEQUENCE = int(dialect.MAV_MISSION_NO_SPACE), int(dialect.MAV_MISSION_INVALID_SEQUENCE)
ERROR = int(dialect.MAV_MISSION_ERROR)


def _key(port: Port, message: Message) -> Key:
    return (id(port), *sender(message), message.mission_type)


def _acknowledge(port: Port, message: Message, result: int) -> None:
    port.send(dialect.MAVLink_mission_ack_message(*sender(message), result, getattr(message, "mission_type", 0)))


def say_current(node: Node) -> None:
    """Send MISSION_CURRENT on all ports, and store the current item (0: the mission is finished) for the next boot."""
    commander = node.vehicle.commander
    commander.flight.plans.remember(0 if commander.mission.complete else commander.mission.current)
    node.forget_telemetry()
    for port in node.ports:
        port.send_telemetry(BY_NAME["MISSION_CURRENT"].message_id)


def _replace(node: Node, kind: int, items: tuple[PlanItem, ...]) -> None:
    commander = node.vehicle.commander
    commander.replace_plan(kind, items)
    if why := commander.flight.plans.unsaved:
        node.complain(f"Plans not saved: {why}")
    if kind == MISSION:
        say_current(node)


# download


def request_list(node: Node, port: Port, message: Message) -> None:
    """Reply with the number of items of a plan."""
    if message.mission_type not in KINDS:
        _acknowledge(port, message, UNSUPPORTED)
        return
    count = len(node.vehicle.commander.flight.plans.items[message.mission_type])
    port.send(dialect.MAVLink_mission_count_message(*sender(message), count, message.mission_type))


def request_item(node: Node, port: Port, message: Message) -> None:
    """Reply with one item: MISSION_ITEM_INT to MISSION_REQUEST_INT, else MISSION_ITEM."""
    if message.mission_type not in KINDS:
        _acknowledge(port, message, UNSUPPORTED)
        return
    commander, kind, seq = node.vehicle.commander, message.mission_type, message.seq
    items = commander.flight.plans.items[kind]
    if seq >= len(items):
        _acknowledge(port, message, INVALID_SEQUENCE)
        return
    item = items[seq]
    current = int(kind == MISSION and seq == commander.mission.current)
    head = (*sender(message), seq, item.frame, item.command, current, item.autocontinue, *item.p)
    if message.get_type() == "MISSION_REQUEST_INT":
        port.send(dialect.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, kind))
    else:
        scale = 1e-7 if item.frame in GLOBAL_FRAMES else 1.0
        port.send(dialect.MAVLink_mission_item_message(*head, item.x * scale, item.y * scale, item.z, kind))


# upload


def count(node: Node, port: Port, message: Message) -> None:
    """Begin an upload, or begin it again if the message is repeated. A count of 0 clears the plan."""
    kind = message.mission_type
    if kind not in KINDS:
        _acknowledge(port, message, UNSUPPORTED)
    elif message.count > CAPACITY[kind]:
        _acknowledge(port, message, NO_SPACE)
    elif not message.count:
        node.uploads.end(_key(port, message))
        _replace(node, kind, ())
        _acknowledge(port, message, ACCEPTED)
    else:
        upload = Upload(port, sender(message), kind, message.count, node.time_us, node.time_us)
        if node.uploads.begin(_key(port, message), upload):
            upload.request(node.time_us)
        else:
            _acknowledge(port, message, ERROR)


def take_item(node: Node, port: Port, message: Message) -> None:
    """Take the requested item of an upload. If another item arrives, request the expected item again."""
    upload = node.uploads.get(_key(port, message))
    if upload is None:
        _acknowledge(port, message, ERROR)
        return
    upload.received_us = node.time_us
    if upload.taken_us is not None:
        upload.acknowledge(ACCEPTED)  # the acknowledgement was lost
        return
    if message.seq != len(upload.items):
        upload.request(node.time_us)
        return
    item = _item(message)
    result = plans.refusal(upload.kind, item, upload.count)
    upload.items.append(item)
    if result == ACCEPTED and len(upload.items) == upload.count:
        result = plans.plan_refusal(upload.kind, tuple(upload.items))
        if result == ACCEPTED:
            upload.taken_us = node.time_us
            _replace(node, upload.kind, tuple(upload.items))
            upload.items = []
            upload.acknowledge(ACCEPTED)
            return
    if result != ACCEPTED:
        node.complain(f"Plan refused: item {message.seq}")
        upload.acknowledge(result)
        node.uploads.end(_key(port, message))
    else:
        upload.request(node.time_us)


def _item(m: Message) -> PlanItem:
    x, y = m.x, m.y
    if m.get_type() == "MISSION_ITEM":
        scale = 1e7 if m.frame in GLOBAL_FRAMES else 1.0
        x, y = (
            round(v * scale) if math.isfinite(v) and abs(v * scale) < NO_COORDINATE else NO_COORDINATE for v in (x, y)
        )
    return PlanItem(m.command, m.frame, (m.param1, m.param2, m.param3, m.param4), x, y, m.z, m.autocontinue)


def acknowledged(node: Node, port: Port, message: Message) -> None:
    """Handle MISSION_ACK: the client has ended a download or cancelled its upload."""
    if message.type == CANCELLED:
        node.uploads.end(_key(port, message))


def refuse(node: Node, port: Port, message: Message) -> None:
    """Reject a partial write: a plan is only replaced as a whole. (PX4 sends no answer.)"""
    _acknowledge(port, message, UNSUPPORTED)


# other messages


def clear_all(node: Node, port: Port, message: Message) -> None:
    """Empty one plan or all of them."""
    kind = message.mission_type
    kinds = KINDS if kind == dialect.MAV_MISSION_TYPE_ALL else (kind,)
    if any(plan_kind not in KINDS for plan_kind in kinds):
        _acknowledge(port, message, UNSUPPORTED)
        return
    for plan_kind in kinds:
        _replace(node, plan_kind, ())
    _acknowledge(port, message, ACCEPTED)


def set_current(node: Node, port: Port, message: Message) -> None:
    """Continue the mission at an item, and send MISSION_CURRENT on all ports."""
    if not node.vehicle.commander.fly_item(message.seq):
        node.complain(f"Mission item {message.seq} does not exist")
    say_current(node)


def tell_progress(node: Node) -> None:
    """Send MISSION_ITEM_REACHED for the items reached since the last call, and MISSION_CURRENT."""
    reached = node.vehicle.commander.mission.reached
    for seq in reached:
        node.broadcast(dialect.MAVLink_mission_item_reached_message(seq))
    reached.clear()
    say_current(node)
