"""Ports of the devices: shared serial ports, UDP and TCP."""

import math
import os
import pty
import select
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_py.assemble import devices as module
from firmware_py.assemble.devices import close_all, create_line, open_devices, open_lines, shared_port_warnings
from firmware_py.common.records import DeviceRole
from firmware_py.system.network_line import TcpLine, UdpLine
from firmware_py.system.serial_port import PortError
from firmware_py.vehicle import VehicleError, parse
from hil.devices.ais_frames import position_a, sentences
from hil.devices.nmea_text import whole_sentence
from support.flight_controller import Board
from support.program import unused_ports

SHIP = sentences(position_a(211000001, 36.0, 121.0, 10.0, 90.0, 92))
NMEA = whole_sentence("HCHDT,98.3,T") + whole_sentence("GPRMC,120000.00,A,3600.00,N,12100.00,E,1.0,90.0,010126,,,A")


@pytest.fixture
def ports():
    """Three serial lines, each with the descriptor of its other end and its path."""
    pairs = [pty.openpty() for _ in range(3)]
    yield [(master, os.ttyname(slave)) for master, slave in pairs]
    for master, slave in pairs:
        os.close(master)
        os.close(slave)


def open_vehicle(tmp_path, compass, position, ais):
    def section(driver, port):
        return {"driver": driver, "port": port, **({} if port.startswith("udp:") else {"baud": 38400})}

    sections = {"compass": compass, "position": position, "rudder": compass, "ais": ais}
    data = {name: section("nmea", port) for name, port in sections.items() if port is not None}
    data["rudder"] = {"driver": "volz", "port": sections["rudder"] + "r", "baud": 115200}
    return open_devices(parse(data, tmp_path / "boat.toml"), wait=True)


def read_counts(devices, now_s=0.2):
    for line in devices.lines:
        if line.connected:
            select.select([line], [], [], 60.0)
    for device in (devices.compass, devices.position, devices.vessels):
        if device is not None:
            device.receive(now_s)
    return len(devices.compass.poll()), len(devices.position.poll()), len(devices.vessels.poll())


@pytest.mark.parametrize("port_numbers", [(0, 1, 2), (0, 0, 0), (0, 1, 1), (0, 1, 0), (0, 0, 1)])
def test_ais_has_its_own_port_or_shares_one(tmp_path, ports, port_numbers):
    devices = open_vehicle(tmp_path, *(ports[number][1] for number in port_numbers))
    try:
        for number in set(port_numbers):
            os.write(ports[number][0], SHIP + NMEA + NMEA if number in port_numbers[:2] else SHIP)
        headings, _, ships = read_counts(devices)
        assert (headings, ships) == (2, 1)
        assert len(devices.lines) == len(set(port_numbers)) + 1
    finally:
        close_all(devices.lines)


def test_power_monitor_shares_the_port_of_compass_and_position(tmp_path, ports):
    """A flight controller serves all three; the views are read in the order of the loop."""
    (master, port), board = ports[0], Board()
    sections = {name: {"driver": "mavlink", "port": port, "baud": 38400} for name in ("compass", "position", "power")}
    rudder = {"driver": "volz", "port": ports[1][1], "baud": 115200}
    devices = open_devices(parse({**sections, "rudder": rudder}, tmp_path / "boat.toml"), wait=True)
    try:
        assert len(devices.lines) == 2
        battery = dialect.MAVLink_battery_status_message(0, 0, 0, 0, [12_800] + [0xFFFF] * 9, -1, -1, -1, -1)
        fix = dialect.MAVLink_gps_raw_int_message(1, 3, 360000000, 1210000000, 0, 80, 80, 50, 0, 9)
        os.write(master, board.heartbeat() * 2 + board.ekf() + board.attitude() + board.pack(fix) + board.pack(battery))
        select.select([devices.lines[0]], [], [], 60.0)
        (monitor,) = devices.power
        counts = []
        for device in (devices.compass, devices.position, monitor):
            device.receive(1.0)
            counts.append(len(device.poll()))
        assert counts == [1, 1, 1]
        parser, senders = dialect.MAVLink(None), set()
        while len(senders) < 3:
            assert select.select([master], [], [], 10.0)[0]
            senders |= {message.get_srcComponent() for message in parser.parse_buffer(os.read(master, 4096)) or ()}
        assert senders == {191, 192, 193}  # component ids, one of each driver
    finally:
        close_all(devices.lines)


def test_second_compass_and_power_monitor_have_their_own_role_and_line(tmp_path):
    def section(driver, name):
        return {"driver": driver, "port": f"/dev/missing-{name}", "baud": 19200}

    drivers = {"compass": "nmea", "rudder": "volz", "compass_b": "nmea", "power": "vedirect", "power_b": "vedirect"}
    data = {name: section(driver, name) for name, driver in drivers.items()}
    devices = open_devices(parse(data, tmp_path / "boat.toml"), wait=True)
    sensors = (devices.compass, devices.compass_b, *devices.power)
    roles = (DeviceRole.COMPASS, DeviceRole.COMPASS_B, DeviceRole.POWER, DeviceRole.POWER_B)
    assert tuple(sensor.health(1.0).role for sensor in sensors) == roles
    assert sorted(line.name for line in devices.lines) == sorted(entry["port"] for entry in data.values())
    close_all(devices.lines)


WEATHER = whole_sentence("WIMWV,30.0,R,5.0,M,A") + whole_sentence("SDDPT,12.0,0.5")


@pytest.mark.parametrize("shares", [True, False])
def test_wind_and_depth_share_the_port_of_the_other_nmea_devices_or_have_their_own(tmp_path, ports, shares):
    main_port, own_port = ports[0], ports[0] if shares else ports[1]
    nmea = {"driver": "nmea", "baud": 38400}
    data = {
        **{name: nmea | {"port": main_port[1]} for name in ("compass", "position", "ais")},
        **{name: nmea | {"port": own_port[1]} for name in ("wind", "depth")},
        "rudder": {"driver": "volz", "port": main_port[1] + "r", "baud": 115200},
    }
    devices = open_devices(parse(data, tmp_path / "boat.toml"), wait=True)
    try:
        os.write(main_port[0], SHIP + NMEA + NMEA)
        os.write(own_port[0], WEATHER)
        everything = (devices.compass, devices.position, devices.wind, devices.depth, devices.vessels)
        counts = [0] * len(everything)
        while counts[0] < 2 or 0 in counts[2:]:  # the bytes may arrive in pieces
            assert select.select([line for line in devices.lines if line.connected], [], [], 60.0)[0], counts
            for number, device in enumerate(everything):
                device.receive(0.2)
                counts[number] += len(device.poll())
        assert counts[0] == 2
        assert counts[2:] == [1, 1, 1]
        assert len(devices.lines) == (2 if shares else 3)
    finally:
        close_all(devices.lines)


@pytest.mark.parametrize("section", ["compass", "position", "power"])
def test_flight_controller_on_a_network_is_refused(tmp_path, section):
    serial = {"driver": "nmea", "port": "/dev/ttyS0", "baud": 4800}
    data = {
        "compass": serial,
        "rudder": serial | {"driver": "volz"},
        section: {"driver": "mavlink", "port": "udp:14550"},
    }
    with pytest.raises(VehicleError, match=f"{section}.*driver mavlink writes to its device and needs a serial port"):
        parse(data, tmp_path / "boat.toml")


def test_ais_by_udp(tmp_path, ports):
    (port,) = unused_ports(["udpin"])
    devices = open_vehicle(tmp_path, ports[0][1], ports[1][1], f"udp:{port}")
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(SHIP.rstrip(), ("127.0.0.1", port))
            sender.sendto(b"\xff" * 3000, ("127.0.0.1", port))
            sender.sendto(SHIP, ("127.0.0.1", port))
        devices.vessels.receive(1.0)
        assert len(devices.vessels.poll()) == 1
        assert devices.vessels.health(1.0).accepted == 2
    finally:
        close_all(devices.lines)


INVALID_UDP_PORTS = ["udp:", "udp:0", "udp:70000", "udp:x", "udp:127.0.0.1:1a", "udp:192.0.2.1:10110"]


@pytest.mark.parametrize("name", INVALID_UDP_PORTS)
def test_invalid_udp_port_is_rejected_in_one_line(name):
    with pytest.raises(PortError, match=r"^port udp:[^\n]*(write udp:PORT|choose another)[^\n]*$"):
        UdpLine(name).open()


@pytest.mark.parametrize("name", ["tcp:", "tcp:10110", "tcp:boat.local:10110", "tcp:127.0.0.1:0", "tcp:[::1]:10110"])
def test_invalid_tcp_server_is_rejected_in_one_line(name):
    with pytest.raises(PortError, match=r"^port tcp:[^\n]*: write tcp:ADDRESS:PORT [^\n]*$"):
        TcpLine(name).open()


def test_compass_by_tcp_is_read_again_after_its_server_has_closed(tmp_path, ports):
    with socket.create_server(("127.0.0.1", 0)) as server:
        data = {
            "compass": {"driver": "nmea", "port": f"tcp:127.0.0.1:{server.getsockname()[1]}"},
            "rudder": {"driver": "volz", "port": ports[0][1], "baud": 115200},
        }
        devices = open_devices(parse(data, tmp_path / "boat.toml"), wait=False)
        line = devices.lines[0]
        try:
            for now_s in (1.0, 3.0):
                with server.accept()[0] as client:
                    client.sendall(whole_sentence("HCHDT,45.0,T") + b"$HCHDT,46.0")  # truncated
                    select.select([line.fileno()], [], [], 5.0)
                    devices.compass.receive(now_s)
                    assert [round(math.degrees(sample.heading_rad)) for sample in devices.compass.poll()] == [45]
                select.select([line.fileno()], [], [], 5.0)
                devices.compass.receive(now_s)
                assert line.fileno() == -1
                line.reopen(now_s + 1.0)
                assert line.openings > 1
        finally:
            close_all(devices.lines)


def test_missing_tcp_server_is_tried_again():
    (port,) = unused_ports(["tcpin"])
    line = TcpLine(f"tcp:127.0.0.1:{port}")
    line.open()
    select.select([line.fileno()], [], [], 5.0)
    assert (line.read(), line.connected, line.read(), line.write(b"x")) == (b"", False, b"", False)
    line.reopen(1.0)
    assert line.connected
    line.close()


def test_used_udp_port_is_opened_when_it_is_free():
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


class FakeLine:
    """A line whose port exists or not."""

    def __init__(self, *, exists):
        self.exists, self.is_open = exists, False

    def open(self):
        if not self.exists:
            raise PortError("no such port")
        self.is_open = True

    def close(self):
        self.is_open = False


def test_missing_port_closes_the_others_unless_the_autopilot_waits_for_it():
    lines = [FakeLine(exists=exists) for exists in (True, False, True)]
    with pytest.raises(PortError, match="no such port"):
        open_lines(lines, wait=False)
    assert [line.is_open for line in lines] == [False, False, False]
    texts = []
    open_lines(lines, wait=True, report=texts.append)
    assert [line.is_open for line in lines] == [True, False, True]
    assert texts == ["waiting for no such port"]


def test_reason_is_reported_for_each_port_that_the_autopilot_waits_for(tmp_path):
    data = {
        "compass": {"driver": "nmea", "port": "/dev/missing", "baud": 4800},
        "rudder": {"driver": "pwm", "port": f"pwm:{tmp_path}/missing/0"},
    }
    texts = []
    open_devices(parse(data, tmp_path / "boat.toml"), wait=True, report=texts.append)
    pwm_text = "no such PWM chip; load its overlay (pwm) and correct the path in the vehicle file"
    assert sorted(texts) == [
        "waiting for port /dev/missing: no such port; plug the device in or correct the path in the vehicle file",
        f"waiting for port pwm:{tmp_path}/missing/0: {pwm_text}",
    ]


def test_ports_that_other_programs_have_open_are_reported(ports, monkeypatch):
    lines = [create_line(ports[0][1], 4800), create_line("/dev/missing", 4800), create_line("tcp:127.0.0.1:1", 0)]
    lines[0].open()
    lines[2].open()
    monkeypatch.setattr(module, "find_port_users", lambda paths: dict.fromkeys(paths, "cat"))
    try:
        assert shared_port_warnings(lines) == [f"Port {ports[0][1]}: also open in cat; end that program"]
    finally:
        close_all(lines)


def test_serial_port_is_opened_again_after_ten_seconds_without_bytes(ports, tmp_path):
    path = tmp_path / "port"
    path.symlink_to(ports[0][1])
    line = create_line(str(path), 4800)
    line.open()
    path.unlink()
    path.symlink_to(ports[1][1])
    try:
        for now_s, number in ((100.0, 0), (109.0, 0), (110.0, 1)):
            line.reopen(now_s)
            assert line.write(b"x")
            (master,) = select.select([master for master, _ in ports], [], [], 10.0)[0]
            assert (master, os.read(master, 10)) == (ports[number][0], b"x")
    finally:
        line.close()
