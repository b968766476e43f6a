"""The common part of the drivers of compasses with a binary protocol."""

import pytest

from firmware_py.common.records import DeviceState
from firmware_py.sensors.packet_receiver import PacketReceiver
from firmware_py.sensors.rion import create_framer

GOOD = bytes.fromhex("68 0D 00 84 00 20 10 10 05 25 01 80 00 7C")
DAMAGED = GOOD[:-1] + b"\x7d"


@pytest.fixture
def receiver(line):
    receiver = PacketReceiver(line, create_framer)
    assert receiver.notice_reopening()
    return receiver


def receive(line, receiver, data, now_s=1.0):
    line.inbox += data
    return [packet.data for packet in receiver.read(now_s) if not packet.fault]


def test_packets_are_returned_and_damaged_ones_are_counted(line, receiver):
    assert receive(line, receiver, GOOD + DAMAGED + DAMAGED + GOOD) == [GOOD, GOOD]
    health = receiver.monitor.health(1.0)
    assert (health.rejected, health.text) == (1, "checksum")  # bytes without a packet between count once
    assert receive(line, receiver, b"noise" + GOOD) == [GOOD]
    assert receiver.monitor.health(1.0).rejected == 1


def test_bytes_without_a_packet_are_reported(line, receiver):
    assert receive(line, receiver, b"") == []
    assert receiver.monitor.health(1.0).text == ""
    assert receive(line, receiver, b"\x80\x10") == []
    assert receiver.monitor.health(1.0).text == "data not understood: wrong baud rate?"


def test_incomplete_packet_is_discarded_when_the_port_is_opened_again(line, receiver):
    assert receive(line, receiver, GOOD[:7]) == []
    assert not receiver.notice_reopening()
    line.unplug()
    line.plug()
    assert receiver.notice_reopening()
    assert receive(line, receiver, GOOD[7:]) == []
    assert receive(line, receiver, GOOD) == [GOOD]


def test_state_and_samples(line, receiver):
    receiver.monitor.accept(1.0)
    assert receiver.monitor.health(2.9).state is DeviceState.RUNNING
    assert receiver.monitor.health(3.1).state is DeviceState.SILENT
    receiver.samples += range(600)
    assert receiver.poll() == tuple(range(88, 600))
    assert receiver.poll() == ()
