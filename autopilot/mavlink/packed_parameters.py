"""All parameters as one small file, `@PARAM/param.pck`, which MAVProxy and pymavlink ask for before anything else.

Source of the format: ArduPilot, AP_Filesystem documentation of param.pck. A record is type, name and value; a name
tells only what differs from the one before.
"""

import struct
from itertools import takewhile

from autopilot.parameters import ParameterTable

MAGIC = 0x671B
INT32, FLOAT = 3, 4


def packed(parameters: ParameterTable) -> bytes:
    """Return the file: head with the count, then every parameter in the order of its name."""
    count = len(parameters)
    records = [struct.pack("<HHH", MAGIC, count, count)]
    before = ""
    for name in parameters.names:
        alike = takewhile(lambda pair: pair[0] == pair[1], zip(before, name, strict=False))
        shared = min(sum(1 for _ in alike), len(name) - 1, 15)
        rest = name[shared:].encode()
        integer = parameters.is_integer(name)
        head = bytes((INT32 if integer else FLOAT, shared | (len(rest) - 1) << 4))
        value = struct.pack("<i", int(parameters[name])) if integer else struct.pack("<f", parameters[name])
        records.append(head + rest + value)
        before = name
    return b"".join(records)
