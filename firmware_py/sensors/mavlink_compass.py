"""Driver of a flight controller (ArduPilot, PX4) as compass, over MAVLink.

Sources: the definitions common.xml and ardupilotmega.xml; ArduPilot, "Requesting Data From The Autopilot"; PX4,
"MAVLink Peripherals".

The mounting on the boat belongs to the flight controller (AHRS_ORIENTATION, SENS_BOARD_ROT): its x axis must point to
the bow. The yaw of ATTITUDE refers to true north if the flight controller knows the declination of its position
(COMPASS_AUTODEC and EKF2_DECL_TYPE, both on by default); state `reference = "magnetic"` if it does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import option
from firmware_py.common.records import DeviceHealth, DeviceRole, HeadingSample, NorthReference
from firmware_py.sensors.device_monitor import NO_HEADING_YET
from firmware_py.sensors.mavlink_board import (
    COMPASS_COMPONENT,
    MavlinkDevice,
    MavlinkOptions,
    Wanted,
)
from firmware_py.sensors.mavlink_frames import (
    MAV_AUTOPILOT_ARDUPILOTMEGA,
    MAV_AUTOPILOT_PX4,
    Frame,
    Message,
    Stream,
)
from firmware_py.sensors.message_error import check_range
from firmware_py.sensors.mounting import VERTICAL, Mounting, rotation

STATUS_RATE_HZ = 2.0
STATUS_TIMEOUT_S = 3.0  # without a report of the estimator for this time, its headings are not valid
MAX_RATE_RAD_S = 40.0  # the largest range of a gyroscope is 2000 deg/s, 35 rad/s
MAX_TEST_RATIO = 1.0  # of the innovation of the magnetometer; the filter rejects a larger one

_ATTITUDE_VALID = 1 << 0  # of EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS
_EKF_UNINITIALIZED = 1 << 10  # of EKF_STATUS_FLAGS only
_ANGLE_TOLERANCE_RAD = 1e-4  # of single precision
NO_STATUS = "heading not valid: no estimator status"


@dataclass(frozen=True, slots=True)
class MavlinkCompassOptions(MavlinkOptions):
    """Options of the vehicle file for a flight controller as compass; raises ValueError."""

    rate_hz: int = option("headings per second, an integer", default=10, minimum=1, maximum=50)
    reference: str = option(
        "north of the yaw; magnetic if the flight controller does not correct for the declination",
        default="true",
        choices=("true", "magnetic"),
    )
    require_status: bool = option(
        "whether a heading needs a report that the estimator is valid (EKF_STATUS_REPORT, ESTIMATOR_STATUS)",
        default=True,
    )


class MavlinkCompass(MavlinkDevice[HeadingSample]):
    """Returns the yaw of ATTITUDE while the estimator of the flight controller reports that its attitude is valid.

    A heading is not valid without such a report for STATUS_TIMEOUT_S, after a restart until the next report, and while
    the estimator rejects its magnetometer, or near a vertical position, where yaw and roll turn about the same axis.
    """

    def __init__(self, line: ByteLine, options: MavlinkCompassOptions) -> None:
        """Store line and options."""
        wanted = (
            Wanted(Message.ATTITUDE, options.rate_hz, Stream.EXTRA1),
            Wanted(Message.EKF_STATUS_REPORT, STATUS_RATE_HZ, Stream.EXTRA3, MAV_AUTOPILOT_ARDUPILOTMEGA),
            Wanted(Message.ESTIMATOR_STATUS, STATUS_RATE_HZ, Stream.EXTRA3, MAV_AUTOPILOT_PX4),
        )
        super().__init__(line, options, DeviceRole.COMPASS, COMPASS_COMPONENT, wanted)
        self._mounting = Mounting("none")
        self._reference = NorthReference.TRUE if options.reference == "true" else NorthReference.MAGNETIC
        self._requires_status = options.require_status
        self._is_vertical = False
        self._forget()

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s; send heartbeats and requests."""
        super().receive(now_s)
        self._monitor.note(self._board.other_text)

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state; FAULTY while the estimator is not valid or the board is nearly vertical.

        Each attitude counts as accepted.
        """
        return self._monitor.health(now_s, self._fault or (VERTICAL if self._is_vertical else ""))

    def _forget(self) -> None:
        self._status_s: float | None = None  # time of the last report; before the first one, of the first attitude
        self._is_valid = False  # by the last report
        self._fault = ""

    def _handle(self, frame: Frame, now_s: float) -> None:
        self._monitor.note_unused(NO_HEADING_YET)
        if frame.message is Message.ATTITUDE:
            self._handle_attitude(frame.fields, now_s)
        elif frame.message is Message.EKF_STATUS_REPORT:
            compass_variance, flags = frame.fields[3], frame.fields[5]
            is_ready = bool(flags & _ATTITUDE_VALID) and not flags & _EKF_UNINITIALIZED
            self._set_status(now_s, is_ready=is_ready, test_ratio=compass_variance)
        elif frame.message is Message.ESTIMATOR_STATUS:
            mag_ratio, flags = frame.fields[4], frame.fields[9]
            self._set_status(now_s, is_ready=bool(flags & _ATTITUDE_VALID), test_ratio=mag_ratio)

    def _set_status(self, now_s: float, *, is_ready: bool, test_ratio: float) -> None:
        """Store a report; a ratio that is NaN belongs to an estimator without a magnetometer."""
        self._status_s = now_s
        self._fault = ""
        if not is_ready:
            self._fault = "heading not valid: estimator not ready"
        elif test_ratio > MAX_TEST_RATIO:
            self._fault = "heading not valid: magnetometer rejected"
        self._is_valid = not self._fault

    def _handle_attitude(self, fields: tuple[float, ...], now_s: float) -> None:
        _, roll_rad, pitch_rad, yaw_rad, *rates_rad_s = fields  # about x (bow), y (starboard), z (down)
        check_range(roll_rad, -math.pi - _ANGLE_TOLERANCE_RAD, math.pi + _ANGLE_TOLERANCE_RAD, "roll")
        check_range(pitch_rad, -math.pi / 2 - _ANGLE_TOLERANCE_RAD, math.pi / 2 + _ANGLE_TOLERANCE_RAD, "pitch")
        check_range(yaw_rad, -math.pi - _ANGLE_TOLERANCE_RAD, math.tau + _ANGLE_TOLERANCE_RAD, "yaw")
        for rate_rad_s in rates_rad_s:
            check_range(rate_rad_s, -MAX_RATE_RAD_S, MAX_RATE_RAD_S, "rate of turn")
        self._monitor.accept(now_s)
        x_rad_s, y_rad_s, z_rad_s = rates_rad_s
        boat = self._mounting.boat_attitude(rotation(roll_rad, pitch_rad, yaw_rad), (x_rad_s, y_rad_s, z_rad_s))
        self._is_vertical = boat is None
        if not self._is_heading_valid(now_s) or boat is None:
            return
        self._samples.append(
            HeadingSample(
                t_s=now_s,
                heading_rad=boat.heading_rad,
                reference=self._reference,
                yaw_rate_rad_s=boat.yaw_rate_rad_s,
                roll_rad=boat.roll_rad,
                pitch_rad=boat.pitch_rad,
            )
        )

    def _is_heading_valid(self, now_s: float) -> bool:
        if not self._requires_status:
            return not self._fault
        if self._status_s is None:
            self._status_s = now_s
        if now_s - self._status_s > STATUS_TIMEOUT_S:
            self._is_valid = False
            self._fault = NO_STATUS
        return self._is_valid


DRIVER = Driver(
    interface=INTERFACE,
    device="flight controllers (ArduPilot, PX4) over MAVLink",
    options=MavlinkCompassOptions,
    make=MavlinkCompass,
    writes=True,
)
