"""The ship on ArduPilot's simulator interface, which receives servo pulses and returns the motion as JSON.

The protocol is that of ArduPilot's SITL JSON backend (libraries/SITL/examples/JSON/readme.md): the autopilot sends
UDP packets `<HHI16H` (magic 18458, frame rate, frame number, 16 pulses in us; with SERVO_32_ENABLE 32 pulses and
magic 29569) and waits for one line after each. So the autopilot is the ship's clock: the ship advances one frame for
each packet.
"""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass

from firmware_py.common.angles import radians, wrap_pi
from hil.devices.emulator import METRES_PER_DEGREE
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG, World

PACKET, MAGIC = struct.Struct("<HHI16H"), 18458
PACKET_32, MAGIC_32 = struct.Struct("<HHI32H"), 29569
MAX_FRAMES = 100  # advanced by one packet; a larger gap means that the autopilot has restarted
FIRST_FRAMES = (0, 1)  # of an autopilot that has restarted
INACTIVE_S = 2.0  # time without packets after which another autopilot may take control
RATES_HZ = (10, 10_000)
CENTRE_US, HALF_US = 1500.0, 400.0  # ArduPilot's defaults for a servo: 1100 to 1900
MIN_PULSE_US, MAX_PULSE_US = 800, 2200  # outside there is no pulse: the servo keeps its angle
GRAVITY_M_S2 = 9.80665


class PacketError(ValueError):
    """A packet is not from ArduPilot or not from the active autopilot; the text states the reason."""


@dataclass(frozen=True, slots=True)
class Pulses:
    """One packet: frame rate, frame number, and the pulses in us."""

    rate_hz: int
    frame: int
    pulses_us: tuple[int, ...]


def read_packet(data: bytes) -> Pulses:
    """Decode a packet; raise PacketError for an invalid one."""
    formats = {PACKET.size: (PACKET, MAGIC), PACKET_32.size: (PACKET_32, MAGIC_32)}
    if len(data) not in formats:
        raise PacketError(f"a packet of {len(data)} bytes; ArduPilot's have {PACKET.size} or {PACKET_32.size}")
    layout, expected = formats[len(data)]
    magic, rate_hz, frame, *pulses_us = layout.unpack(data)
    if magic != expected:
        raise PacketError(f"a packet that begins with {magic}; ArduPilot's of this length begin with {expected}")
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise PacketError(f"frame rate {rate_hz} Hz is not supported; use {RATES_HZ[0]} to {RATES_HZ[1]} Hz")
    return Pulses(rate_hz, frame, tuple(pulses_us))


class ActiveAutopilot:
    """The autopilot in control; another one may replace it after INACTIVE_S without packets."""

    def __init__(self) -> None:
        """Start without an autopilot."""
        self.address: tuple[str, int] | None = None
        self._received_s = -math.inf

    def receive(self, address: tuple[str, int], now_s: float) -> bool:
        """Register a packet; return True if it is from a new autopilot. Raise PacketError for a second one."""
        is_new = address != self.address
        if is_new and now_s - self._received_s < INACTIVE_S:
            host, port = address
            raise PacketError(f"autopilot at {host}:{port} is ignored while another one is active")
        self.address, self._received_s = address, now_s
        return is_new


class JsonShip:
    """Advance a world with the frames of an autopilot and return its sensor values.

    `servo` is the number of the steering output from 1 on, `travel_rad` the rudder angle at 1900 us.
    """

    def __init__(self, world: World, *, servo: int, travel_rad: float) -> None:
        """Start before the first frame."""
        self._world = world
        world.shaft.set_torque(on=True)
        self._servo, self._travel_rad = servo, travel_rad
        self._frame: int | None = None
        self._velocity_m_s = self._velocity()
        self._reply = b""

    @property
    def now_s(self) -> float:
        """Return the simulated time."""
        return self._world.now_s

    def reply(self, packet: Pulses) -> bytes:
        """Return the line for a packet; for a repeated or late packet the last line again."""
        elapsed = 1 if self._frame is None else packet.frame - self._frame
        is_late = -MAX_FRAMES <= elapsed < 0 and packet.frame not in FIRST_FRAMES
        if self._reply and (elapsed == 0 or is_late):
            return self._reply
        if not 1 <= elapsed <= MAX_FRAMES:  # the autopilot has restarted or was away
            elapsed = 1
        self._frame = packet.frame
        pulse_us = packet.pulses_us[self._servo - 1]
        if MIN_PULSE_US <= pulse_us <= MAX_PULSE_US:
            deflection = max(-1.0, min((pulse_us - CENTRE_US) / HALF_US, 1.0))
            self._world.shaft.set_target(deflection * self._travel_rad)
        duration_s = elapsed / packet.rate_hz
        self._world.advance_to(self._world.now_s + duration_s)
        self._reply = self._line(duration_s)
        return self._reply

    def _line(self, duration_s: float) -> bytes:
        world = self._world
        heading_rad = wrap_pi(world.heading_rad())
        previous, self._velocity_m_s = self._velocity_m_s, self._velocity()
        north_m_s2 = (self._velocity_m_s[0] - previous[0]) / duration_s
        east_m_s2 = (self._velocity_m_s[1] - previous[1]) / duration_s
        cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
        longitude_m = METRES_PER_DEGREE * math.cos(radians(START_LATITUDE_DEG))
        state = {
            "timestamp": world.now_s,
            "imu": {
                "gyro": [0.0, 0.0, world.yaw_rate_rad_s()],
                "accel_body": [
                    north_m_s2 * cosine + east_m_s2 * sine, east_m_s2 * cosine - north_m_s2 * sine, -GRAVITY_M_S2,
                ],
            },
            "position": [
                (world.latitude_deg() - START_LATITUDE_DEG) * METRES_PER_DEGREE,
                (world.longitude_deg() - START_LONGITUDE_DEG) * longitude_m,
                0.0,
            ],
            "attitude": [0.0, 0.0, heading_rad],
            "velocity": [*self._velocity_m_s, 0.0],
        }  # fmt: skip
        return b"\n" + json.dumps(state, allow_nan=False).encode("ascii") + b"\n"

    def _velocity(self) -> tuple[float, float]:
        speed_m_s, course_rad = self._world.speed_over_ground_m_s(), self._world.course_over_ground_rad()
        return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)
