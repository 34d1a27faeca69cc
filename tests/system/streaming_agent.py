"""An agent that a test kills during a step. It takes off, then streams 1.2 m/s ahead through the link without end.

python streaming_agent.py URL
"""

import sys

from foundation.mavlink import dialect
from foundation.setpoints import Velocity
from hil.link.link import Link
from hil.link.transport import connect

link = Link(connect(sys.argv[1]))
link.connect()
link.wait_for(lambda state: state.healthy, 60.0, "becoming ready to arm")
link.arm()
link.order("take-off", dialect.MAV_CMD_NAV_TAKEOFF)
link.wait_for(lambda state: state.mode == "HOLD" and state.landed is False, 60.0, "reaching take-off height")
link.fly(Velocity(forward=1.2, up=None))
link.start_offboard()
while True:
    link.tick()
