"""MAVLink's parameter protocol. As in PX4, the float field carries the bytes of an INT32."""

import struct

from autopilot.mavlink.node import PARAMETER_LIST, Node, Port, sender
from autopilot.mavlink.status_makers import Message
from autopilot.parameters import ParameterTable
from foundation.mavlink import dialect, first_field

INT32, REAL32 = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32
_INTEGER_PAYLOAD = struct.Struct("<iHH16sB")


class _IntegerValue(dialect.MAVLink_param_value_message):  # type: ignore[misc]
    """PARAM_VALUE of an INT32, packed as an integer, because packing as a float may change a signalling NaN."""

    def __init__(self, name: bytes, value: int, count: int, index: int) -> None:
        super().__init__(name, 0.0, INT32, count, index)
        self._integer = value

    def pack(self, mav: object, force_mavlink1: bool = False) -> bytes:
        payload = _INTEGER_PAYLOAD.pack(
            self._integer, self.param_count, self.param_index, self._param_id_raw, self.param_type
        )
        return bytes(self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1))


def parameter_value(parameters: ParameterTable, name: str) -> Message:
    """Return the PARAM_VALUE of one parameter. Raises KeyError for an unknown name."""
    value, count, index = parameters[name], len(parameters), parameters.index(name)
    if parameters.is_integer(name):
        return _IntegerValue(name.encode(), int(value), count, index)
    return dialect.MAVLink_param_value_message(name.encode(), value, REAL32, count, index)


def request_list(node: Node, port: Port, message: Message) -> None:
    """Start to send the whole list on this port, each parameter with its value at the time of sending."""
    parameters = node.vehicle.parameters
    port.transfers[PARAMETER_LIST] = (parameter_value(parameters, name) for name in parameters.names)


def request_read(node: Node, port: Port, message: Message) -> None:
    """Answer with the value by index, or by name when the index is -1; PARAM_ERROR when there is no such parameter."""
    parameters = node.vehicle.parameters
    name, index = message.param_id, message.param_index
    if 0 <= index < len(parameters):
        name = parameters.names[index]
    elif index != -1:
        name = ""
    if name in parameters:
        port.send(parameter_value(parameters, name))
    else:
        _refuse(port, message, index, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST)


def set_value(node: Node, port: Port, message: Message) -> None:
    """Set a value; send it on all ports if it changed. For a value of the wrong type, the reply is the old value."""
    parameters, name = node.vehicle.parameters, message.param_id
    if name not in parameters:
        _refuse(port, message, -1, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST)
        return
    if message.param_type != (INT32 if parameters.is_integer(name) else REAL32):
        node.complain(f"Parameter {name}: wrong type, not set")
        port.send(parameter_value(parameters, name))
        return
    value = struct.unpack("<i" if parameters.is_integer(name) else "<f", first_field(message))[0]
    before = parameters[name]
    try:
        parameters.set(name, value)
    except ValueError:
        _refuse(port, message, parameters.index(name), dialect.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE)
        return
    if parameters.unsaved is not None:
        node.complain(f"Parameters not saved: {parameters.unsaved}")
    if parameters[name] == before:
        port.send(parameter_value(parameters, name))
    else:
        node.broadcast(parameter_value(parameters, name))


def _refuse(port: Port, message: Message, index: int, error: int) -> None:
    name = message.param_id.encode("ascii", "replace")[:16]
    port.send(dialect.MAVLink_param_error_message(*sender(message), name, index, error))
