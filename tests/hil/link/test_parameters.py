"""The parameter client with an autopilot that answers, a silent autopilot, and a lossy wire."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.errors import LinkError, UsageError
from foundation.mavlink import Packer, Parser, dialect
from hil.link.parameters import RETRY_US, TRIES, Parameters, decoded


def test_integers_and_floats_are_read_with_their_types(meet):
    _, link = meet()
    values = Parameters(link).read_many(["COM_OF_LOSS_T", "NAV_RCL_ACT", "COM_FLTMODE1"])
    assert values == {"COM_OF_LOSS_T": 1.0, "NAV_RCL_ACT": 2, "COM_FLTMODE1": -1}
    assert [type(value) for value in values.values()] == [float, int, int]
    assert link.listeners == []


@pytest.mark.parametrize("tells", [True, False])
def test_an_unknown_parameter_reads_as_none(meet, tells):
    autopilot, link = meet(tells_unknown=tells)
    began_us = link.time_us
    assert Parameters(link).read_many(["NO_SUCH", "NAV_RCL_ACT"]) == {"NO_SUCH": None, "NAV_RCL_ACT": 2}
    if tells:
        assert link.time_us - began_us < RETRY_US
    else:
        assert autopilot.message_types.count("PARAM_REQUEST_READ") <= 2 * TRIES


def test_an_unknown_parameter_cannot_be_set(meet):
    _, link = meet()
    with pytest.raises(LinkError, match="NO_SUCH"):
        Parameters(link).set("NO_SUCH", 1)


@pytest.mark.parametrize(("name", "value"), [("COM_OBL_RC_ACT", 5), ("COM_FLTMODE1", -1), ("COM_OF_LOSS_T", 0.5)])
def test_a_parameter_is_set_to_its_value_and_type(meet, name, value):
    autopilot, link = meet()
    assert Parameters(link).set(name, value) == value
    assert autopilot.parameters[name] == value
    assert type(autopilot.parameters[name]) is type(value)


def test_an_ignored_change_is_reported_with_both_values(meet):
    _, link = meet(keeps=("COM_OBL_RC_ACT",))
    with pytest.raises(LinkError, match=r"COM_OBL_RC_ACT.* 0 .* 5"):
        Parameters(link).set("COM_OBL_RC_ACT", 5)


def test_an_unanswered_change_is_reported(meet):
    _, link = meet(deaf_to=("PARAM_SET",))
    with pytest.raises(LinkError, match=r"COM_OBL_RC_ACT.* 0 "):
        Parameters(link).set("COM_OBL_RC_ACT", 5)


@pytest.mark.parametrize(
    ("name", "value"), [("COM_OBL_RC_ACT", 2.5), ("COM_OBL_RC_ACT", 1 << 31), ("COM_OF_LOSS_T", 1e39)]
)
def test_a_value_out_of_range_for_its_type_is_rejected_before_it_is_sent(meet, name, value):
    autopilot, link = meet()
    with pytest.raises(UsageError, match=name):
        Parameters(link).set(name, value)
    assert "PARAM_SET" not in autopilot.message_types


@pytest.mark.parametrize("name", ["", "A_NAME_OF_MORE_THAN_16", "SÜSS"])
def test_an_invalid_parameter_name_is_rejected(meet, name):
    _, link = meet()
    with pytest.raises(UsageError, match="parameter"):
        Parameters(link).read(name)


def test_parameters_are_read_and_set_although_a_third_of_the_requests_is_lost(meet):
    autopilot, link = meet()
    autopilot.loses = lambda number: number % 3 == 0
    client = Parameters(link)
    names = sorted(autopilot.parameters)
    assert client.read_many(names) == {name: autopilot.parameters[name] for name in names}
    assert client.set("COM_OBL_RC_ACT", 5) == 5


@given(st.integers(-(1 << 31), (1 << 31) - 1))
def test_every_integer_is_decoded_from_its_bytes(value):
    frame = bytearray(Packer(1, 1).pack(dialect.MAVLink_param_value_message(b"X", 1.0, 6, 900, 1)))
    frame[10:14] = struct.pack("<i", value)
    frame[-2:] = checksum(frame)
    (message,) = Parser().feed(bytes(frame))
    assert decoded(message) == value


def checksum(frame):
    from pymavlink.generator.mavcrc import x25crc

    crc = x25crc(bytes(frame[1:-2]))
    crc.accumulate(bytes([dialect.MAVLink_param_value_message.crc_extra]))
    return struct.pack("<H", crc.crc)
