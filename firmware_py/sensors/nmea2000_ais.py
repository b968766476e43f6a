"""Driver of an AIS receiver or transponder on an NMEA 2000 bus.

The messages contain the fields of ITU-R M.1371 in the units of NMEA 2000: class A position (PGN 129038) and static data
(129794), class B position (129039) and static data, parts A and B (129809, 129810).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import option
from firmware_py.common.records import DeviceRole
from firmware_py.common.vessels import (
    STATUS_UNKNOWN,
    VesselIdentity,
    VesselKind,
    VesselPosition,
    VesselReport,
    is_distress_number,
)
from firmware_py.sensors.ais_messages import MAX_MMSI
from firmware_py.sensors.message_error import RANGE, MessageError
from firmware_py.sensors.nmea2000_device import Nmea2000Device, numbers_of
from firmware_py.sensors.nmea2000_frames import Message
from firmware_py.sensors.nmea2000_layout import Values, read_texts
from firmware_py.sensors.nmea2000_reader import Nmea2000Options
from firmware_py.sensors.nmea2000_table import LAYOUTS
from firmware_py.sensors.vessel_queue import VesselQueue

POSITION_A, POSITION_B, STATIC_A, STATIC_B_NAME, STATIC_B_SIZE = 129038, 129039, 129794, 129809, 129810
SILENT_AFTER_S = 600.0  # for minutes, no other vessel may be in range
SOURCE_TIMEOUT_S = 60.0  # then another device may become the source
MAX_SPEED_M_S = 52.7  # a little above 102.2 knots, the highest speed of ITU-R M.1371
MAX_TURN_RATE_RAD_S = math.radians(12.0)  # 708 degrees a minute; more states only the direction
MAX_LENGTH_M, MAX_BEAM_M = 1022, 126  # the sums of two distances of ITU-R M.1371
# Field `ais_transceiver_information`: sent on channel A (2) or B (3), own information that is not transmitted (4).
_OWN_TRANSMISSIONS = frozenset((2, 3, 4))
_AUXILIARY_CRAFT = 98  # first digits of an MMSI; the MMSI of the mother ship replaces the dimensions


@dataclass(frozen=True, slots=True)
class Nmea2000AisOptions(Nmea2000Options):
    """Options of the vehicle file for AIS on an NMEA 2000 bus."""

    own_mmsi: int = option(
        "MMSI of the boat; reports of other stations with this MMSI are rejected. 0: taken from the boat's transponder",
        default=0,
        minimum=0,
        maximum=MAX_MMSI,
    )


class Nmea2000Ais(Nmea2000Device[VesselReport]):
    """Returns the newest reports of other vessels, as AisReceiver does for NMEA 0183.

    Messages with a report and the boat's own messages count as accepted.
    """

    def __init__(self, line: ByteLine, options: Nmea2000AisOptions) -> None:
        """Store the line and the options."""
        pgns = (POSITION_A, POSITION_B, STATIC_A, STATIC_B_NAME, STATIC_B_SIZE)
        super().__init__(line, options, DeviceRole.AIS, "AIS", pgns, SOURCE_TIMEOUT_S, SILENT_AFTER_S)
        self._own_mmsi = options.own_mmsi
        self._learns_own_mmsi = not options.own_mmsi
        self._queue = VesselQueue()

    def fileno(self) -> int:
        """Return -1: AIS data do not wake the loop."""
        return -1

    def poll(self) -> Sequence[VesselReport]:
        """Return the first reports of the queue, a limited number; positions first, as in the log."""
        return self._queue.take()

    def _handle_message(self, message: Message, now_s: float) -> None:
        if not self._is_used(message, now_s):
            return
        values = numbers_of(message)
        mmsi = int(values["user_id"] or 0)
        if values["ais_transceiver_information"] in _OWN_TRANSMISSIONS:
            if self._learns_own_mmsi and mmsi:
                self._own_mmsi = mmsi
            self._monitor.accept(now_s)
            return
        if not mmsi:
            raise MessageError(RANGE, "MMSI is invalid")
        if mmsi == self._own_mmsi:
            raise MessageError(RANGE, f"another station uses the boat's MMSI {mmsi:09d}")
        report: VesselReport | None
        if message.pgn in (POSITION_A, POSITION_B):
            kind = VesselKind.CLASS_A if message.pgn == POSITION_A else VesselKind.CLASS_B
            report = position_of(mmsi, kind, values, now_s)
        else:
            report = identity_of(mmsi, values, read_texts(LAYOUTS[message.pgn], message.data), now_s)
        if report is None:
            return
        self._monitor.accept(now_s)
        if not self._queue.add(report):
            self._monitor.reject(now_s, "too many vessels, some dropped")


def position_of(mmsi: int, kind: VesselKind, values: Values, now_s: float) -> VesselReport | None:
    """Return the position report of a vessel; without a position only a distress beacon is reported."""
    latitude_deg, longitude_deg = values["latitude_deg"], values["longitude_deg"]
    if latitude_deg is None or longitude_deg is None:
        return VesselIdentity(now_s, mmsi) if is_distress_number(mmsi) else None
    speed_m_s, course_rad, heading_rad = values["sog_m_s"], values["cog_rad"], values["heading_rad"]
    turn_rad_s, status = values.get("rate_of_turn_rad_s"), values.get("nav_status")
    return VesselPosition(
        t_s=now_s,
        mmsi=mmsi,
        kind=kind,
        latitude_rad=radians(latitude_deg),
        longitude_rad=radians(longitude_deg),
        speed_m_s=speed_m_s if speed_m_s is not None and speed_m_s <= MAX_SPEED_M_S else None,
        course_rad=None if course_rad is None else wrap_two_pi(course_rad),
        heading_rad=None if heading_rad is None else wrap_two_pi(heading_rad),
        turn_rad_s=turn_rad_s if turn_rad_s is not None and abs(turn_rad_s) <= MAX_TURN_RATE_RAD_S else None,
        status=STATUS_UNKNOWN if status is None else int(status),
        accurate=bool(values["position_accuracy"]),
    )


def identity_of(mmsi: int, values: Values, texts: dict[str, str], now_s: float) -> VesselReport | None:
    """Return the static data of a message; None if it has none, unless it is that of a distress beacon."""
    identity = VesselIdentity(
        t_s=now_s,
        mmsi=mmsi,
        name=texts.get("name", ""),
        call_sign=texts.get("callsign", ""),
        ship_type=int(values.get("type_of_ship") or 0),
        dimensions_m=None if mmsi // 10**7 == _AUXILIARY_CRAFT else _dimensions_m(values),
    )
    has_content = identity.name or identity.call_sign or identity.ship_type or identity.dimensions_m
    return identity if has_content or is_distress_number(mmsi) else None


def _dimensions_m(values: Values) -> tuple[int, int, int, int] | None:
    """Return the distances from the antenna to bow, stern, port and starboard; None if they are not available."""
    length_m, beam_m = values.get("length_m"), values.get("beam_m")
    to_bow_m = values.get("position_reference_from_bow_m")
    to_starboard_m = values.get("position_reference_from_starboard_m")
    if length_m is None or beam_m is None or not (length_m or beam_m):
        return None
    if length_m > MAX_LENGTH_M or beam_m > MAX_BEAM_M:
        return None
    to_bow_m, to_starboard_m = to_bow_m or 0.0, to_starboard_m or 0.0
    if to_bow_m > length_m or to_starboard_m > beam_m:
        return None
    distances_m = to_bow_m, length_m - to_bow_m, beam_m - to_starboard_m, to_starboard_m
    to_bow, to_stern, to_port, to_starboard = (round(distance_m) for distance_m in distances_m)
    return to_bow, to_stern, to_port, to_starboard


DRIVER = Driver(
    interface=INTERFACE,
    device="AIS on an NMEA 2000 bus (PGN 129038, 129039, 129794, 129809, 129810), by a gateway or SocketCAN",
    options=Nmea2000AisOptions,
    make=Nmea2000Ais,
    reads_can=True,
)
