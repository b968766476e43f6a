"""The ground station of the bench with a vehicle of pymavlink."""

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


def pack(message, system=1):
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=1)))


HEARTBEAT = pack(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3))


def test_station_waits_for_a_heartbeat(link):
    station, vehicle = link
    vehicle.send(pack(dialect.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)))
    vehicle.send(HEARTBEAT)
    assert station.await_heartbeat(5.0) is not None
    assert station.await_heartbeat(0.0) is None


def test_station_sends_heartbeats_after_the_first_message(link):
    station, vehicle = link
    station.send(b"no receiver")
    vehicle.send(HEARTBEAT)
    station.await_heartbeat(5.0)
    vehicle.send(HEARTBEAT)
    station.await_heartbeat(5.0)
    message = dialect.MAVLink(None).decode(bytearray(vehicle.recv(512)))
    assert (message.get_type(), message.type) == ("HEARTBEAT", dialect.MAV_TYPE_GCS)
    station.send(b"hello")
    assert vehicle.recv(512) == b"hello"


def test_all_messages_of_a_datagram_are_received(link):
    station, vehicle = link
    value = pack(dialect.MAVLink_param_value_message(b"A", 1.0, 9, 1, 0))
    vehicle.send(HEARTBEAT + value)
    assert [message.get_type() for message in station.receive()] == ["HEARTBEAT", "PARAM_VALUE"]
