"""Units of the driver as in maestro-servo, a library for the USB interface of the Maestro without serial protocol."""

import math
from types import SimpleNamespace

import pytest
from maestro.channel import Channel
from maestro.enums import ChannelMode, Request

from firmware_py.actuator.maestro import MaestroOptions, maestro_rudder


class UsbMaestro:
    """Stores the control transfers of the library."""

    def __init__(self):
        self.dev = self
        self.transfers = []

    def ctrl_transfer(self, _kind, request, wValue, wIndex):  # noqa: N803 - names of the library
        self.transfers.append((request, wValue, wIndex))


@pytest.fixture
def channel():
    return Channel(UsbMaestro(), 3, ChannelMode.Servo)


@pytest.fixture
def frames(fakes):
    """Function that returns the frames of the driver by their commands, for an angle of the shaft."""

    def frames(shaft_rad, **options):
        line = fakes.line(SimpleNamespace(handle=lambda _data: b"\0\0"))
        rig = fakes.rig(maestro_rudder(line, MaestroOptions(channel=3, us_per_rad=500.0, **options)))
        rig.ticks(2, shaft_deg=math.degrees(shaft_rad))
        data = b"".join(line.written)
        return {command: data[data.index(command) :][:4] for command in (0x84, 0x87)}

    return frames


@pytest.mark.parametrize("pulse_us", [1000, 1250, 1500, 2000])
def test_target_is_that_of_the_library(channel, frames, pulse_us):
    channel.target = pulse_us
    ((request, value, index),) = channel.maestro.transfers
    assert request is Request.SetTarget
    assert frames((pulse_us - 1500) / 500.0)[0x84] == bytes([0x84, index, value & 0x7F, value >> 7])


def test_speed_limit_and_position_are_those_of_the_library(channel, frames):
    channel.speed = 140
    ((_, value, index),) = channel.maestro.transfers
    assert frames(0.0, speed=140)[0x87] == bytes([0x87, index, value & 0x7F, value >> 7])
    channel._position = 6000  # what the driver reads as 1500 us
    assert math.isclose(channel.position, 1500.0)
