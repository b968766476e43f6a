"""The bench's end of a UDP link, with a vehicle made of pymavlink."""

import socket

import pytest
from pymavlink.dialects.v20 import common as dialect

from hil.bench.station import Station


@pytest.fixture
def link():
    station = Station()
    vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    vehicle.settimeout(5.0)
    _, host, port = station.url.split(":")
    vehicle.connect((host, int(port)))
    yield station, vehicle
    vehicle.close()
    station.close()


def packed(message, system=1):
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=1)))


HEARTBEAT = packed(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3))


def test_await_message(link):
    station, vehicle = link
    vehicle.send(packed(dialect.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)))
    vehicle.send(HEARTBEAT)
    assert station.await_heartbeat(5.0) is not None
    assert station.await_heartbeat(0.0) is None


def test_send_and_heartbeats(link):
    station, vehicle = link
    station.send(b"into the void")
    vehicle.send(HEARTBEAT)
    station.await_heartbeat(5.0)
    vehicle.send(HEARTBEAT)
    station.await_heartbeat(5.0)
    message = dialect.MAVLink(None).decode(bytearray(vehicle.recv(512)))
    assert (message.get_type(), message.type) == ("HEARTBEAT", dialect.MAV_TYPE_GCS)
    station.send(b"hello")
    assert vehicle.recv(512) == b"hello"


def test_messages_of_a_datagram(link):
    station, vehicle = link
    value = packed(dialect.MAVLink_param_value_message(b"A", 1.0, 9, 1, 0))
    vehicle.send(HEARTBEAT + value)
    assert [message.get_type() for message in station.receive()] == ["HEARTBEAT", "PARAM_VALUE"]
