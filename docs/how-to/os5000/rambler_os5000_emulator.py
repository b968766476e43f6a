"""Emulated OS5000 compass for rambler-hil, with a codec of its own."""

from __future__ import annotations

from math import degrees

from hil.devices.emulator import Device, DeviceContext, EmulatedDevice
from hil.devices.timing import Pace, Transmitter

RATE_HZ = 10.0
NOISE_DEG = 0.3


class Os5000Emulator:
    """A compass that sends its factory format; commands are ignored. `context.world` is what it measures."""

    def __init__(self, context: DeviceContext) -> None:
        """Start with the phase and the clock error of this run."""
        self._world = context.world
        self._rng = context.rng
        self._declination_deg = context.declination_deg
        self._pace = Pace(1.0 / RATE_HZ, start_s=context.phase_s, error_ppm=context.frequency_error_ppm)
        self.transmitter = Transmitter(context.baud)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore commands."""

    def next_output_s(self) -> float:
        """Return when the next sample is taken or the next sentence is complete."""
        return min(self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete sentences."""
        for sample_s in self._pace.take(now_s):
            noise_deg = float(self._rng.normal(0.0, NOISE_DEG))
            magnetic_deg = degrees(self._world.heading_rad()) - self._declination_deg + noise_deg
            self.transmitter.send(sample_s, sentence(f"C{round(magnetic_deg * 10) % 3600 / 10:.1f}P0.0R0.0T20.0"))
        return self.transmitter.take(now_s)


def sentence(body: str) -> bytes:
    """Return a body as a sentence with its checksum."""
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode("ascii")


def _make(context: DeviceContext) -> Device:
    return Os5000Emulator(context)


EMULATOR = EmulatedDevice(interface=1, driver="os5000", baud=19200, make=_make)
