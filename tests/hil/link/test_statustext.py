import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.errors import LinkError
from foundation.mavlink import dialect
from hil.link.link import Link
from hil.link.telemetry import PIECE, StatusTexts
from tests.hil.link.scripted_vehicle import ScriptedVehicle


def pieces(text, text_id, severity=2):
    cut = [text[i : i + PIECE] for i in range(0, len(text), PIECE)]
    return [dialect.MAVLink_statustext_message(severity, c.encode(), text_id, n) for n, c in enumerate(cut)]


@given(st.lists(st.text("abcdefgh ", min_size=1, max_size=180).filter(str.strip), min_size=1, max_size=5))
def test_texts_sent_in_chunks_are_reassembled_in_order(texts):
    status_texts = StatusTexts()
    for number, text in enumerate(texts, 1):
        for piece in pieces(text, number):
            status_texts.take(piece, 7)
    status_texts.since(0)
    assert [entry.text for entry in status_texts.newest] == [" ".join(text.split()) for text in texts]


def test_since_returns_recent_texts_of_at_least_warning_severity():
    status_texts = StatusTexts()
    for time_us, severity, text in ((1, 2, b"old"), (5, 6, b"chatter"), (5, 4, b"warning\t"), (6, 4, b"warning")):
        status_texts.take(dialect.MAVLink_statustext_message(severity, text), time_us)
    assert status_texts.since(5) == "warning"


def test_an_error_ends_with_the_whole_text_of_the_last_warning():
    vehicle = ScriptedVehicle()
    link = Link(vehicle.transport())
    link.connect(10.0)
    text = "Preflight Fail: the estimate of the heading is not valid, calibrate the compass"
    for piece in pieces(text, 7):
        vehicle.say(piece)
    vehicle.say(dialect.MAVLink_statustext_message(6, b"all is well"))
    with pytest.raises(LinkError, match=f"; the autopilot said: {text}$"):
        link.wait_for(lambda state: False, 1.0, "arming")
