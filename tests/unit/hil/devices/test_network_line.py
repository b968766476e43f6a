"""An operator's link to an autopilot on another computer, against plain sockets."""

import socket
from contextlib import closing

import pytest

from hil.devices.network_line import NetworkLine, NetworkLineError


def come(line, wanted):
    """Read until so much has come; loopback needs a moment, so the socket is waited on."""
    data = b""
    while len(data) < wanted:
        line._socket.settimeout(5.0)
        line._socket.recv(1, socket.MSG_PEEK)
        line._socket.setblocking(False)
        data += line.read()
    return data


@pytest.fixture
def listener():
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        server.settimeout(5.0)
        yield server


@pytest.fixture
def datagrams():
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as far:
        far.bind(("127.0.0.1", 0))
        far.settimeout(5.0)
        yield far


def test_tcp(listener):
    port = listener.getsockname()[1]
    with closing(NetworkLine(f"127.0.0.1:{port}")) as line:
        far, _ = listener.accept()
        assert line.write(b"hello") == 5
        assert far.recv(9) == b"hello"
        far.sendall(b"world")
        assert come(line, 5) == b"world"
        assert line.read() == b""
        assert line.plugged
        far.close()
        line._socket.settimeout(5.0)
        line._socket.recv(1, socket.MSG_PEEK)
        line._socket.setblocking(False)
        assert line.read() == b""
        assert not line.plugged


def test_udpout(datagrams):
    with closing(NetworkLine(f"udpout:127.0.0.1:{datagrams.getsockname()[1]}")) as line:
        assert line.write(b"hello") == 5
        data, sender = datagrams.recvfrom(9)
        datagrams.sendto(data[::-1], sender)
        assert come(line, 5) == b"olleh"


def test_udpin_sends_to_the_last_sender(datagrams):
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with closing(NetworkLine(f"udpin:127.0.0.1:{port}")) as line:
        assert line.write(b"unused") == 0
        assert line.overrun_bytes == 6
        datagrams.sendto(b"here", ("127.0.0.1", port))
        assert come(line, 4) == b"here"
        line.write(b"there")
        assert datagrams.recv(9) == b"there"


@pytest.mark.parametrize("url", ["", "tcp:", "host:0", "host:1:2", "udpout:host:70000", "udpin:host:x"])
def test_invalid_urls(url):
    with pytest.raises(NetworkLineError, match="write HOST"):
        NetworkLine(url)


def test_connection_refused(datagrams):
    with pytest.raises(NetworkLineError, match="127"):
        NetworkLine(f"127.0.0.1:{datagrams.getsockname()[1]}")
