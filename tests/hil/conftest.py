import pytest

from hil.link.link import Link
from tests.hil.link import listening
from tests.hil.preflight.damaged_autopilot import Autopilot


@pytest.fixture
def meet():
    """Return a function that starts an autopilot with the given faults and returns it with a connected link."""
    opened = []

    def start(**wrong):
        transport = listening.udp()
        autopilot = Autopilot(f"udpout://127.0.0.1:{transport.port}", **wrong)
        link = Link(transport)
        opened.append((autopilot, link))
        autopilot.start()
        link.connect(10.0)
        return autopilot, link

    yield start
    for autopilot, link in opened:
        autopilot.stop()
        link.close()
