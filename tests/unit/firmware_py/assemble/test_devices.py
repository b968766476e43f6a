"""Which ports are opened for AIS, and what its driver hears on them."""

import math
import os
import pty
import select
import socket

import pytest

from firmware_py.assemble.devices import close_all, open_devices
from firmware_py.system.network_line import TcpLine, UdpLine
from firmware_py.system.serial_port import PortError
from firmware_py.vehicle import parse
from hil.devices.ais_frames import position_a, sentences
from hil.devices.nmea_text import whole_sentence
from support.program import unused_ports

SHIP = sentences(position_a(211000001, 36.0, 121.0, 10.0, 90.0, 92))
NMEA = whole_sentence("HCHDT,98.3,T") + whole_sentence("GPRMC,120000.00,A,3600.00,N,12100.00,E,1.0,90.0,010126,,,A")


@pytest.fixture
def ports():
    """Three lines: their far ends and their names."""
    pairs = [pty.openpty() for _ in range(3)]
    yield [(master, os.ttyname(slave)) for master, slave in pairs]
    for master, slave in pairs:
        os.close(master)
        os.close(slave)


def opened(tmp_path, compass, position, ais):
    def section(driver, port):
        return {"driver": driver, "port": port, **({} if port.startswith("udp:") else {"baud": 38400})}

    sections = {"compass": compass, "position": position, "rudder": compass, "ais": ais}
    data = {name: section("nmea", port) for name, port in sections.items() if port is not None}
    data["rudder"] = {"driver": "volz", "port": sections["rudder"] + "r", "baud": 115200}
    return open_devices(parse(data, tmp_path / "boat.toml"), wait=True)


def read(devices, seconds=0.2):
    for line in devices.lines:
        if line.connected:
            select.select([line], [], [], 60.0)
    for device in (devices.compass, devices.position, devices.vessels):
        if device is not None:
            device.receive(seconds)
    return len(devices.compass.poll()), len(devices.position.poll()), len(devices.vessels.poll())


@pytest.mark.parametrize("places", [(0, 1, 2), (0, 0, 0), (0, 1, 1), (0, 1, 0), (0, 0, 1)])
def test_ais_has_a_port_of_its_own_or_shares_one(tmp_path, ports, places):
    devices = opened(tmp_path, *(ports[place][1] for place in places))
    try:
        for place in set(places):
            os.write(ports[place][0], SHIP + NMEA + NMEA if place in places[:2] else SHIP)
        headings, _, ships = read(devices)
        assert (headings, ships) == (2, 1)
        assert len(devices.lines) == len(set(places)) + 1
    finally:
        close_all(devices.lines)


def test_ais_comes_by_udp(tmp_path, ports):
    (port,) = unused_ports(["udpin"])
    devices = opened(tmp_path, ports[0][1], ports[1][1], f"udp:{port}")
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(SHIP.rstrip(), ("127.0.0.1", port))
            sender.sendto(b"\xff" * 3000, ("127.0.0.1", port))
            sender.sendto(SHIP.replace(b"A,1", b"A,1"), ("127.0.0.1", port))
        devices.vessels.receive(1.0)
        assert len(devices.vessels.poll()) == 1
        assert devices.vessels.health(1.0).accepted == 2
    finally:
        close_all(devices.lines)


WRONG = ["udp:", "udp:0", "udp:70000", "udp:x", "udp:127.0.0.1:1a", "udp:192.0.2.1:10110"]


@pytest.mark.parametrize("name", WRONG)
def test_an_address_that_cannot_be_listened_at_is_refused_in_one_line(name):
    with pytest.raises(PortError, match=r"^port udp:[^\n]*(write udp:PORT|choose another)[^\n]*$"):
        UdpLine(name).open()


@pytest.mark.parametrize("name", ["tcp:", "tcp:10110", "tcp:boat.local:10110", "tcp:127.0.0.1:0", "tcp:[::1]:10110"])
def test_a_server_that_is_no_address_is_refused_in_one_line(name):
    with pytest.raises(PortError, match=r"^port tcp:[^\n]*: write tcp:ADDRESS:PORT [^\n]*$"):
        TcpLine(name).open()


def test_a_compass_comes_by_tcp_and_again_after_its_server_has_ended(tmp_path, ports):
    with socket.create_server(("127.0.0.1", 0)) as server:
        data = {
            "compass": {"driver": "nmea", "port": f"tcp:127.0.0.1:{server.getsockname()[1]}"},
            "rudder": {"driver": "volz", "port": ports[0][1], "baud": 115200},
        }
        devices = open_devices(parse(data, tmp_path / "boat.toml"), wait=False)
        line = devices.lines[0]
        try:
            for moment_s in (1.0, 3.0):
                with server.accept()[0] as client:
                    client.sendall(whole_sentence("HCHDT,45.0,T") + b"$HCHDT,46.0")  # cut off
                    select.select([line.fileno()], [], [], 5.0)
                    devices.compass.receive(moment_s)
                    assert [round(math.degrees(one.heading_rad)) for one in devices.compass.poll()] == [45]
                select.select([line.fileno()], [], [], 5.0)
                devices.compass.receive(moment_s)
                assert line.fileno() == -1
                line.reopen(moment_s + 1.0)
                assert line.openings > 1
        finally:
            close_all(devices.lines)


def test_a_server_that_is_not_there_is_tried_again():
    (port,) = unused_ports(["tcpin"])
    line = TcpLine(f"tcp:127.0.0.1:{port}")
    line.open()
    select.select([line.fileno()], [], [], 5.0)
    assert (line.read(), line.connected, line.read(), line.write(b"x")) == (b"", False, b"", False)
    line.reopen(1.0)
    assert line.connected
    line.close()


def test_an_address_that_is_taken_is_waited_for():
    (port,) = unused_ports(["udpin"])
    first, second = UdpLine(f"udp:{port}"), UdpLine(f"udp:{port}")
    first.open()
    with pytest.raises(PortError, match="choose another"):
        second.open()
    assert second.read() == b""
    second.reopen(1.0)
    assert not second.connected
    first.close()
    second.reopen(1.5)
    assert not second.connected
    second.reopen(2.5)
    assert second.connected
    second.close()
