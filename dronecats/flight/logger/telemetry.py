"""What the logger asks of an autopilot, so that flight.tlog tells the story in a ground station."""

from collections.abc import Callable

from foundation.mavlink import Packer, dialect

SYSTEM, COMPONENT = 246, 155  # MAV_COMP_ID_LOG
WATCHED = {
    dialect.MAVLINK_MSG_ID_ATTITUDE: 200_000,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 200_000,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 200_000,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1_000_000,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1_000_000,
    dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 200_000,
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1_000_000,
    dialect.MAVLINK_MSG_ID_ODOMETRY: 200_000,  # its reset counter
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 1_000_000,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 5_000_000,
}


def subscribe(send: Callable[[bytes], None], system: int) -> None:
    """Ask the autopilot of `system` for the messages worth keeping, at five a second."""
    packer = Packer(SYSTEM, COMPONENT)
    for message_id, interval_us in WATCHED.items():
        send(
            packer.pack(
                dialect.MAVLink_command_long_message(
                    system, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, interval_us, 0, 0, 0, 0, 0
                )
            )
        )
