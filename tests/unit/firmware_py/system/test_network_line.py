"""Read-only lines of the network: addresses, datagrams, connections that end, and limits."""

import socket

import pytest

from firmware_py.system.network_line import TcpLine, UdpLine
from firmware_py.system.serial_port import PortError


@pytest.mark.parametrize(
    ("name", "address"),
    [
        ("udp:10110", ("", 10110)),
        ("udp:192.0.2.7:1", ("192.0.2.7", 1)),
        ("udp:65535", ("", 65535)),
    ],
)
def test_address_has_a_port_and_perhaps_a_host(name, address):
    assert UdpLine(name).address() == address


@pytest.mark.parametrize("name", ["udp:", "udp:0", "udp:65536", "udp:000001", "udp:x", "udp:-1", "udp:\u0661"])
def test_invalid_port_is_refused(name):
    with pytest.raises(PortError, match="write udp:PORT"):
        UdpLine(name).address()


@pytest.fixture
def udp_line():
    """A line that listens at a free port of this computer, and a sender connected to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    line = UdpLine(f"udp:{port}")
    line.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", port))
        yield line, sender
    line.close()


def test_each_datagram_is_followed_by_a_line_feed(udp_line):
    line, sender = udp_line
    assert line.read() == b""
    sender.send(b"$A")
    sender.send(b"$B")
    assert line.read() == b"$A\n$B\n"
    assert (line.connected, line.openings, line.baud, line.written, line.write(b"x")) == (True, 1, 0, 0, False)
    line.close()
    assert (line.connected, line.fileno(), line.read()) == (False, -1, b"")


def test_read_is_limited_to_64_datagrams_and_about_4096_bytes(udp_line):
    line, sender = udp_line
    for _ in range(70):
        sender.send(b"x")
    assert [line.read(), line.read()] == [b"x\n" * 64, b"x\n" * 6]
    for _ in range(6):
        sender.send(b"y" * 1023)
    assert [len(line.read()), len(line.read())] == [4096, 2048]
    sender.send(b"z" * 3000)
    assert len(line.read()) == 2049


def test_missing_socket_is_opened_again_once_a_second(udp_line):
    line, _ = udp_line
    line.close()
    blocker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    blocker.bind(("127.0.0.1", line.address()[1]))
    with blocker:
        assert line.reopen(10.0) == ""
        assert not line.connected
        with pytest.raises(PortError, match="address already in use; choose another"):
            line.open()
    line.reopen(10.9)
    assert not line.connected
    line.reopen(11.0)
    assert (line.connected, line.openings) == (True, 2)
    line.reopen(99.0)
    assert line.openings == 2


@pytest.mark.parametrize(("host", "address"), [("", "127.0.0.1"), ("0.0.0.0:", "0.0.0.0")])
def test_line_without_a_host_listens_only_to_this_computer(udp_line, host, address):
    closed_line, _ = udp_line
    closed_line.close()
    line = UdpLine(f"udp:{host}{closed_line.address()[1]}")
    line.reopen(0.0)
    assert line._socket.getsockname()[0] == address
    line.close()
    with pytest.raises(PortError, match=r"port udp:a+:1: no such address; choose another"):
        UdpLine(f"udp:{'a' * 70}:1").open()


@pytest.mark.parametrize("name", ["tcp:boat.local:10110", "tcp:10110", "tcp:300.0.0.1:1"])
def test_server_needs_a_numeric_address(name):
    with pytest.raises(PortError, match="with a numeric address"):
        TcpLine(name).open()


def test_connection_to_a_server_is_read_until_it_ends():
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(10.0)
        line = TcpLine(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        line.open()
        connection, _ = server.accept()
        assert line.read() == b""
        connection.send(b"$A\r\n")
        while not (data := line.read()):
            assert line.connected
        assert data == b"$A\r\n"
        client = line._socket
        assert client.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        # An ended connection is noticed after 10 s of silence and 3 probes at intervals of 5 s.
        options = (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT, socket.TCP_SYNCNT)
        assert [client.getsockopt(socket.IPPROTO_TCP, option) for option in options] == [10, 5, 3, 3]
        connection.close()
        while line.connected:
            assert line.read() == b""
        line.reopen(1.0)
        assert (line.connected, line.openings) == (True, 2)
        line.close()
