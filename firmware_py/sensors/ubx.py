"""Driver of a u-blox receiver that sends NAV-PVT."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.geodesy import is_possible_position
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceRole, FixType, PositionSample
from firmware_py.sensors import ubx_protocol as ubx
from firmware_py.sensors.binary_framing import Packet
from firmware_py.sensors.message_error import CHECKSUM, MessageError
from firmware_py.sensors.sensor_driver import SensorDriver
from firmware_py.sensors.ubx_protocol import CAPTURE_FORMAT

MAX_POSITION_ERROR_M = 50.0  # assumed by estimate.position; exceeded after a cold start or under jamming
_NOT_ENABLED_TEXT = "no NAV-PVT: enable UBX-NAV-PVT in the receiver"


@dataclass(frozen=True, slots=True)
class UbxOptions:
    """No options: the receiver is configured with the tools of the manufacturer."""


class UbxPosition(SensorDriver[PositionSample]):
    """Returns one sample per NAV-PVT; the receiver must be configured to send them.

    NMEA on the same line is ignored. hdop is None: NAV-PVT has only PDOP. A fix with a stated accuracy worse than
    MAX_POSITION_ERROR_M is not used. Every valid NAV-PVT counts as accepted.
    """

    def __init__(self, line: ByteLine) -> None:
        """Store the line."""
        super().__init__(line, DeviceRole.POSITION)
        self._framer = ubx.create_framer()

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._framer = ubx.create_framer()
        data = self._line.read()
        if not data:
            return
        self._monitor.note_bytes(now_s)
        if b"$G" in data:
            self._monitor.note_unused(_NOT_ENABLED_TEXT)
        for packet in self._framer.feed(data):
            self._handle_packet(packet, now_s)

    def _handle_packet(self, packet: Packet, now_s: float) -> None:
        if packet.fault:
            if packet.fault == CHECKSUM:
                self._monitor.reject(now_s, CHECKSUM)
            return
        if ubx.message_id(packet.data) != ubx.NAV_PVT:
            self._monitor.note_unused(_NOT_ENABLED_TEXT)
            return
        try:
            solution = ubx.parse_nav_pvt(ubx.payload(packet.data))
        except MessageError as error:
            self._monitor.reject(now_s, str(error))
            return
        self._monitor.accept(now_s)
        if solution.accuracy_m is not None and solution.accuracy_m > MAX_POSITION_ERROR_M:
            self._monitor.note(f"no fix: accuracy {solution.accuracy_m:.0f} m")
            solution = ubx.NavPvt(FixType.NONE, solution.satellites)
        elif solution.lat_deg is not None and not is_possible_position(
            radians(solution.lat_deg), radians(solution.lon_deg or 0.0)
        ):
            self._monitor.note("position invalid: no fix")
            solution = ubx.NavPvt(FixType.NONE, solution.satellites)
        else:
            self._monitor.note("no fix" if solution.fix is FixType.NONE else "")
        self._samples.append(_make_sample(solution, now_s))


def _make_sample(solution: ubx.NavPvt, now_s: float) -> PositionSample:
    return PositionSample(
        t_s=now_s,
        fix=solution.fix,
        latitude_rad=None if solution.lat_deg is None else radians(solution.lat_deg),
        longitude_rad=None if solution.lon_deg is None else radians(solution.lon_deg),
        altitude_m=solution.altitude_m,
        speed_over_ground_m_s=solution.sog_m_s,
        course_over_ground_rad=None if solution.cog_deg is None else wrap_two_pi(radians(solution.cog_deg)),
        satellites=solution.satellites,
        utc_s=solution.utc_s,
    )


DRIVER = Driver(
    interface=INTERFACE,
    device="u-blox receivers that send NAV-PVT",
    options=UbxOptions,
    make=lambda line, _options: UbxPosition(line),
    capture=CAPTURE_FORMAT,
)
