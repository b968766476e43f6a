"""An NMEA 2000 bus behind an Actisense gateway (NGT-1): a compass, an engine, and optionally more devices."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from firmware_py.common.angles import radians
from hil.devices import nmea2000_frames as n2k
from hil.devices.emulator import INTERFACE, Attitude, Device, DeviceContext, EmulatedDevice, Whereabouts
from hil.devices.timing import Pace, Transmitter

COMPASS, SECOND_COMPASS, RECEIVER, ENGINE = 0x23, 0x24, 0x10, 0x05  # addresses
ATTITUDE_PERIOD_S, GNSS_PERIOD_S, COURSE_PERIOD_S, ENGINE_PERIOD_S, CLAIM_PERIOD_S = 1.0, 1.0, 0.25, 0.1, 10.0
START_COMMAND = n2k.actisense_frame(n2k.GATEWAY_COMMAND, b"\x11\x02\x00")  # operating mode: receive all
MAX_COMMAND_BYTES = 256
# Manufacturer codes by address.
_MAKERS = {COMPASS: 1851, SECOND_COMPASS: 1857, RECEIVER: 229, ENGINE: 174}


class Nmea2000Emulator:
    """A gateway that forwards the messages of a bus; after power-up only those of the engine, until it is started.

    The compass sends magnetic headings (PGN 127250) and the rate of turn (127251) at `rate_hz`, and its attitude
    (127257) once a second. More devices can be added. A request of another device makes all devices claim their
    addresses every ten seconds. `bus_commands` counts messages for the bus, which
    the autopilot must not send.
    """

    def __init__(
        self,
        attitude: Attitude,
        rng: np.random.Generator,
        *,
        rate_hz: float = 10.0,
        noise_deg: float = 0.3,
        rate_noise_deg_s: float = 0.05,
        declination_deg: float = 0.0,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        baud: int = 115_200,
    ) -> None:
        """Start all devices at phase_s; raise ValueError for an invalid rate."""
        if not rate_hz > 0.0:
            raise ValueError(f"rate {rate_hz} Hz must be positive")
        self._rng = rng
        self._noise_rad, self._rate_noise_rad_s = radians(noise_deg), radians(rate_noise_deg_s)
        self._declination_rad = radians(declination_deg)
        self.addresses = {COMPASS: COMPASS, SECOND_COMPASS: SECOND_COMPASS}  # may be changed: then the device claims
        self.transmitter = Transmitter(baud)
        self.is_started = False
        self.bus_commands = 0
        self._input = b""
        self._on_s = 0.0
        self._tasks: list[tuple[Pace, Callable[[float], None]]] = []
        self._phase_s, self._frequency_error_ppm = phase_s, frequency_error_ppm
        self._rate_hz = rate_hz
        self._add_compass(COMPASS, attitude, 0.0)
        self._repeat(ENGINE_PERIOD_S, 0.05, self._send_engine)
        self._repeat(CLAIM_PERIOD_S, 0.5, self._send_claims)

    def add_second_compass(self, attitude: Attitude) -> None:
        """Add a compass at another address."""
        self._add_compass(SECOND_COMPASS, attitude, 0.4 / self._rate_hz)

    def add_receiver(self, whereabouts: Whereabouts) -> None:
        """Add a GNSS receiver."""
        self._repeat(GNSS_PERIOD_S, 0.1, partial(self._send_position, whereabouts))
        self._repeat(COURSE_PERIOD_S, 0.02, partial(self._send_course, whereabouts))

    def _add_compass(self, device: int, attitude: Attitude, offset_s: float) -> None:
        self._repeat(1.0 / self._rate_hz, offset_s, partial(self._send_heading, device, attitude))
        self._repeat(ATTITUDE_PERIOD_S, 0.0, partial(self._send_attitude, device))

    def _repeat(self, period_s: float, offset_s: float, send: Callable[[float], None]) -> None:
        pace = Pace(period_s, start_s=self._phase_s + offset_s, error_ppm=self._frequency_error_ppm)
        self._tasks.append((pace, send))

    def receive(self, now_s: float, data: bytes) -> None:
        """Process commands of the autopilot: the start command, and messages for the bus, which are counted."""
        if now_s < self._on_s:
            return
        self._input = (self._input + data)[-MAX_COMMAND_BYTES:]
        self.bus_commands += self._input.count(n2k.DLE + n2k.STX + bytes((n2k.BUS_COMMAND,)))
        if START_COMMAND in self._input:
            self.is_started = True
        if self._input.endswith(n2k.DLE + n2k.ETX):
            self._input = b""

    def power_cycle(self, now_s: float, off_s: float = 0.0) -> None:
        """Switch the gateway off at now_s and on after off_s: it forgets that it was started."""
        self._on_s = now_s + off_s
        self.is_started = False
        self._input = b""
        self.transmitter.clear()

    def next_output_s(self) -> float:
        """Return when the next message is sampled or complete."""
        return min(self.transmitter.next_s(), *(pace.next_s for pace, _ in self._tasks))

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete messages."""
        for pace, send in self._tasks:
            for sample_s in pace.take(now_s):
                send(sample_s)
        return self.transmitter.take(now_s)

    def _send(self, t_s: float, pgn: int, device: int, data: bytes) -> None:
        if t_s >= self._on_s and (self.is_started or device == ENGINE):
            address = self.addresses.get(device, device)
            self.transmitter.send(t_s, n2k.actisense_message(pgn, address, data, t_ms=round(1e3 * t_s)))

    def _send_heading(self, device: int, sensor: Attitude, t_s: float) -> None:
        angle_rad = sensor.heading_rad() - self._declination_rad + self._rng.normal(0.0, self._noise_rad)
        rate_rad_s = sensor.yaw_rate_rad_s() + self._rng.normal(0.0, self._rate_noise_rad_s)
        self._send(t_s, 127251, device, n2k.rate_of_turn(rate_rad_s))
        self._send(t_s, 127250, device, n2k.heading(angle_rad, n2k.MAGNETIC))

    def _send_attitude(self, device: int, t_s: float) -> None:
        self._send(t_s, 127257, device, n2k.attitude(0.02, -0.01))

    def _send_position(self, whereabouts: Whereabouts, t_s: float) -> None:
        latitude_deg, longitude_deg = whereabouts.latitude_deg(), whereabouts.longitude_deg()
        self._send(t_s, 129025, RECEIVER, n2k.position(latitude_deg, longitude_deg))
        self._send(t_s, 129029, RECEIVER, n2k.gnss_position(latitude_deg, longitude_deg, whereabouts.utc_s()))

    def _send_course(self, whereabouts: Whereabouts, t_s: float) -> None:
        speed_m_s, course_rad = whereabouts.speed_over_ground_m_s(), whereabouts.course_over_ground_rad()
        self._send(t_s, 129026, RECEIVER, n2k.course(course_rad, speed_m_s))

    def _send_engine(self, t_s: float) -> None:
        """Send PGN 127488, speed of the engine, and 127489, its dynamic parameters: 16 (DLE) in many places."""
        self._send(t_s, 127488, ENGINE, b"\x00\x10\x10\xff\xff\x7f\xff\xff")
        self._send(t_s, 127489, ENGINE, bytes([0, 0x10, 0x10] + [0x10] * 23))

    def _send_claims(self, t_s: float) -> None:
        """Send the address claims (PGN 60928) of all devices."""
        for device, maker in _MAKERS.items():
            if device != COMPASS and self.addresses.get(device, device) == self.addresses[COMPASS]:
                continue  # two devices never have one address
            name = n2k.to_bytes(n2k.unsigned(1000 + device, 21) + n2k.unsigned(maker, 11) + "0" * 31 + "1")
            self._send(t_s, 60928, device, name)


def require_actisense(context: DeviceContext) -> None:
    """Raise ValueError for a gateway of the vehicle file that is not emulated."""
    if context.options.gateway not in ("auto", "actisense"):
        raise ValueError(f"gateway {context.options.gateway}: only actisense is emulated; use auto")


def _make(context: DeviceContext) -> Device:
    """Return a bus whose compass has the address of the option `source`, if there is one."""
    require_actisense(context)
    bus = Nmea2000Emulator(
        context.world,
        context.rng,
        declination_deg=context.declination_deg,
        phase_s=context.phase_s,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )
    if context.options.source >= 0:
        bus.addresses[COMPASS] = context.options.source
    return bus


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="nmea2000", baud=115_200, make=_make)
