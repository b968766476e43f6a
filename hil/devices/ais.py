"""The boat's AIS transponder of class B, which forwards its own messages and those of other ships.

Ships send at the intervals of ITU-R M.1371-5, by class, speed and anchoring. A message is lost if the ship is out of
range, with a given probability, or if the channel or the serial line is full.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from firmware_py.common.angles import KNOTS_PER_METRE_PER_SECOND
from hil.devices import ais_frames
from hil.devices.ais_frames import Bits
from hil.devices.emulator import METRES_PER_DEGREE, Whereabouts
from hil.devices.timing import Transmitter

STATIC_INTERVAL_S = 360.0
SLOTS_PER_S = 75.0  # of both channels
CAPTURE_FRACTION = 0.35  # share of the range within which a ship is received in a full channel (FM capture effect)
OWN_INTERVAL_S = 30.0
AT_ANCHOR = 1  # navigational status
JUMP_M = 37_000.0  # of the positions of a ship with the error "leaps"
SHIP_SIZE, YACHT_SIZE = (150, 30, 14, 14), (8, 4, 2, 2)  # ais_frames.Dimensions
CARGO, SAILING = 70, 36  # AIS ship types


class Ship(Protocol):
    """Another ship and its AIS equipment."""

    @property
    def mmsi(self) -> int:
        """Its MMSI."""

    @property
    def name(self) -> str:
        """Its name, in capital letters."""

    @property
    def speed_m_s(self) -> float:
        """Speed over ground."""

    @property
    def course_deg(self) -> float:
        """Course over ground."""

    @property
    def station(self) -> str:
        """Equipment: A, B (class) or mark (aid to navigation)."""

    @property
    def at_anchor(self) -> bool:
        """Whether its status is at anchor."""

    @property
    def error_kind(self) -> str:
        """Kind of invalid data: leaps or absurd; empty for none."""

    def position_m(self, t_s: float) -> tuple[float, float]:
        """Return the position north and east of the boat's start."""


def interval_s(ship: Ship) -> float:
    """Return the interval of a ship's position reports."""
    knots = ship.speed_m_s * KNOTS_PER_METRE_PER_SECOND
    if ship.station == "mark":
        return 180.0
    if ship.station == "B":
        return 180.0 if knots < 2.0 else 30.0
    if ship.at_anchor and knots <= 3.0:
        return 180.0
    return 10.0 if knots <= 14.0 else 6.0 if knots <= 23.0 else 2.0


class AisEmulator:
    """The receiver and the transmitter of a transponder on one line."""

    def __init__(
        self,
        whereabouts: Whereabouts,
        start_deg: tuple[float, float],
        ships: Sequence[Ship],
        rng: np.random.Generator,
        *,
        own_mmsi: int,
        range_m: float = 40_000.0,
        lost: float = 0.1,
        baud: int = 38_400,
    ) -> None:
        """Start with the ships around start_deg; each sends first at a random time. `lost` is a probability."""
        self._whereabouts = whereabouts
        self._start_deg = start_deg
        self._ships = tuple(ships)
        self._own_mmsi = own_mmsi
        self._rng = rng
        self._range_m = range_m
        self._lost = lost
        self.transmitter = Transmitter(baud)
        self._sent = 0
        self._slots = SLOTS_PER_S
        self._slots_s = 0.0
        self.unsent = 0  # messages lost because all slots were taken
        # Time, ship (-1: the boat itself), static data (else position), number of messages so far.
        self._due: list[tuple[float, int, bool, int]] = [(1.0, -1, False, 0)]
        for number, ship in enumerate(self._ships):
            self._due.append((float(rng.uniform(0.0, interval_s(ship))), number, False, 0))
            if ship.station != "mark":
                self._due.append((float(rng.uniform(0.0, STATIC_INTERVAL_S)), number, True, 0))
        heapq.heapify(self._due)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input."""

    def next_output_s(self) -> float:
        """Return the time of the next message, or when a sentence is complete on the line."""
        return min(self._due[0][0], self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Create the messages that are due and return the complete sentences."""
        while self._due[0][0] <= now_s:
            report_s, number, is_static, count = heapq.heappop(self._due)
            period_s = OWN_INTERVAL_S if number < 0 else STATIC_INTERVAL_S
            if number >= 0 and not is_static:
                period_s = interval_s(self._ships[number])
            heapq.heappush(self._due, (report_s + period_s, number, is_static, count + 1))
            for data in self._sentences(report_s, number, count, is_static=is_static):
                self._sent += 1
                self.transmitter.send(report_s, data)
        return self.transmitter.take(now_s)

    def _sentences(self, t_s: float, number: int, count: int, *, is_static: bool) -> Iterator[bytes]:
        """Yield the sentences of a station that the transponder receives now."""
        if number < 0:
            yield ais_frames.sentences(self._own_report(), own=True)
            return
        ship = self._ships[number]
        if not self._is_received(ship, t_s):
            return
        for bits in _static_reports(ship) if is_static else (self._position_report(ship, t_s, count),):
            data = ais_frames.sentences(bits, channel="AB"[self._sent % 2], sequence=self._sent)
            yield _damage(data, count) if ship.error_kind == "absurd" else data

    def _is_received(self, ship: Ship, t_s: float) -> bool:
        """Return whether a message is received: in range, in a free slot or from near, and not lost."""
        north_m, east_m = ship.position_m(t_s)
        own_north_m, own_east_m = self._own_position_m()
        distance_m = math.hypot(north_m - own_north_m, east_m - own_east_m)
        if distance_m > self._range_m:
            return False
        self._slots = min(SLOTS_PER_S, self._slots + (t_s - self._slots_s) * SLOTS_PER_S)
        self._slots_s = t_s
        if self._slots < 1.0 and distance_m > CAPTURE_FRACTION * self._range_m:
            self.unsent += 1
            return False
        self._slots = max(0.0, self._slots - 1.0)
        return self._rng.random() >= self._lost

    def _own_position_m(self) -> tuple[float, float]:
        latitude_deg, longitude_deg = self._whereabouts.latitude_deg(), self._whereabouts.longitude_deg()
        cos_latitude = math.cos(math.radians(self._start_deg[0]))
        return (
            (latitude_deg - self._start_deg[0]) * METRES_PER_DEGREE,
            (longitude_deg - self._start_deg[1]) * METRES_PER_DEGREE * cos_latitude,
        )

    def _own_report(self) -> Bits:
        knots = self._whereabouts.speed_over_ground_m_s() * KNOTS_PER_METRE_PER_SECOND
        course_deg = math.degrees(self._whereabouts.course_over_ground_rad()) % 360.0
        position = self._whereabouts.latitude_deg(), self._whereabouts.longitude_deg()
        return ais_frames.position_b(self._own_mmsi, *position, knots, course_deg)

    def _position_report(self, ship: Ship, t_s: float, count: int) -> Bits:
        north_m, east_m = ship.position_m(t_s)
        if ship.error_kind == "leaps" and count % 2:
            north_m += JUMP_M
        latitude_deg = self._start_deg[0] + north_m / METRES_PER_DEGREE
        cos_latitude = math.cos(math.radians(self._start_deg[0]))
        longitude_deg = self._start_deg[1] + east_m / (METRES_PER_DEGREE * cos_latitude)
        knots = ship.speed_m_s * KNOTS_PER_METRE_PER_SECOND
        if ship.error_kind == "absurd":
            return _invalid_report(ship, latitude_deg, longitude_deg, count)
        if ship.station == "mark":
            return ais_frames.mark(ship.mmsi, ship.name, latitude_deg, longitude_deg)
        second = int(self._whereabouts.utc_s()) % 60
        if ship.station == "B":
            return ais_frames.position_b(ship.mmsi, latitude_deg, longitude_deg, knots, ship.course_deg, second=second)
        heading_deg, status = round(ship.course_deg) % 360, AT_ANCHOR if ship.at_anchor else 0
        return ais_frames.position_a(
            ship.mmsi, latitude_deg, longitude_deg, knots, ship.course_deg, heading_deg, status=status, second=second
        )


def _static_reports(ship: Ship) -> tuple[Bits, ...]:
    if ship.station == "B":
        return ais_frames.static_b(ship.mmsi, ship.name, "", SAILING, YACHT_SIZE)
    return (ais_frames.static_a(ship.mmsi, ship.name, f"C{ship.mmsi % 100000}", CARGO, SHIP_SIZE),)


def _invalid_report(ship: Ship, latitude_deg: float, longitude_deg: float, count: int) -> Bits:
    """Return a position report with values out of range or with the codes of unavailable values."""
    speed_kn, course_deg, heading_deg = ais_frames.NO_SPEED, ais_frames.NO_COURSE, ais_frames.NO_HEADING
    positions = (
        (ais_frames.NO_LATITUDE_DEG, ais_frames.NO_LONGITUDE_DEG),
        (-95.0, 10.0),
        (latitude_deg, 222.0),
        (ais_frames.NO_LATITUDE_DEG, longitude_deg),
    )
    mmsi = 0 if count % 7 == 6 else ship.mmsi
    return ais_frames.position_a(mmsi, *positions[count % 4], speed_kn, course_deg, heading_deg)


def _damage(data: bytes, count: int) -> bytes:
    """Return sentences, some of them truncated, changed or mixed with random bytes."""
    if count % 5 == 1:
        return data[: len(data) // 2]
    if count % 5 == 2:
        return data.replace(b"1", b"2", 1)
    if count % 5 == 3:
        return b"\x00\xff!!$*" + data + b"!AIVDM,9,9,9,Z,,9*00\r\n!AIVDM,2,2,1,A,00,0*16\r\n"
    return data
