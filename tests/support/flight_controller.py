"""A flight controller on a line in memory: frames packed by pymavlink, and decoding of what a driver sends."""

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

ARDUPILOT, PX4, INVALID = 3, 12, 8  # MAV_AUTOPILOT_...
# Attitude, velocity, and relative, absolute and predicted position are valid, as on a board with GPS: bits 0 to 5, 8
# and 9 of EKF_STATUS_FLAGS (ArduPilot) and ESTIMATOR_STATUS_FLAGS (PX4).
ALL_VALID = 0x033F


class Board:
    """Packs messages of one component."""

    def __init__(self, system=1, component=1, autopilot=ARDUPILOT, kind=dialect.MAV_TYPE_SURFACE_BOAT):
        self._mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._autopilot, self._kind = autopilot, kind

    def pack(self, message):
        self._mav.seq = (self._mav.seq + 1) % 256
        return bytes(message.pack(self._mav))

    def heartbeat(self):
        return self.pack(
            dialect.MAVLink_heartbeat_message(self._kind, self._autopilot, 0, 0, dialect.MAV_STATE_STANDBY, 3)
        )

    def attitude(self, heading_deg=98.5, boot_ms=10_000, *, roll_deg=0.0, pitch_deg=0.0, rates=(0.0, 0.0, 0.0)):
        """Return an ATTITUDE frame; `rates` are those of roll, pitch and yaw [rad/s]."""
        yaw_rad = math.remainder(math.radians(heading_deg), math.tau)
        angles = (math.radians(roll_deg), math.radians(pitch_deg), yaw_rad)
        return self.pack(dialect.MAVLink_attitude_message(boot_ms, *angles, *rates))

    def ekf(self, flags=ALL_VALID, ratio=0.1):
        """Return the estimator status of ArduPilot; `ratio` is the test ratio of the magnetometer."""
        return self.pack(dialect.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, ratio, 0.0))

    def estimator(self, flags=ALL_VALID, ratio=0.1):
        """Return the estimator status of PX4; `ratio` is the test ratio of the magnetometer."""
        return self.pack(
            dialect.MAVLink_estimator_status_message(1, flags, 0.1, 0.1, 0.1, ratio, 0.0, math.nan, 1.0, 1.0)
        )

    def acknowledgement(self, result, command=dialect.MAV_CMD_SET_MESSAGE_INTERVAL):
        return self.pack(dialect.MAVLink_command_ack_message(command, result))


def decode_all(writes):
    """Return the messages of the frames that a driver has written, one frame a write."""
    return [dialect.MAVLink(None).decode(bytearray(data)) for data in writes]


def requested(writes):
    """Return the ids and intervals in microseconds that a driver has requested."""
    messages = decode_all(writes)
    return [(int(row.param1), int(row.param2)) for row in messages if row.get_type() == "COMMAND_LONG"]


def kinds(writes):
    """Return the names of the messages that a driver has written."""
    return [message.get_type() for message in decode_all(writes)]


def requested_streams(writes):
    """Return the data streams (MAV_DATA_STREAM) that a driver has requested."""
    return [row.req_stream_id for row in decode_all(writes) if row.get_type() == "REQUEST_DATA_STREAM"]
