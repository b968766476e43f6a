"""The link of a ground station on TCP and UDP sockets."""

import socket
from contextlib import closing

import pytest

from hil.devices.network_line import NetworkLine, NetworkLineError


def wait_and_read(line):
    """Wait until the socket has data or is closed, then read once."""
    line._socket.settimeout(5.0)
    line._socket.recv(1, socket.MSG_PEEK)
    line._socket.setblocking(False)
    return line.read()


def read_bytes(line, count):
    data = b""
    while len(data) < count:
        data += wait_and_read(line)
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


def test_tcp_transfers_bytes_until_the_peer_closes(listener):
    port = listener.getsockname()[1]
    with closing(NetworkLine(f"127.0.0.1:{port}")) as line:
        far, _ = listener.accept()
        assert line.write(b"hello") == 5
        assert far.recv(9) == b"hello"
        far.sendall(b"world")
        assert read_bytes(line, 5) == b"world"
        assert line.read() == b""
        assert line.is_plugged
        far.close()
        assert wait_and_read(line) == b""
        assert not line.is_plugged


def test_udpout_sends_and_receives(datagrams):
    with closing(NetworkLine(f"udpout:127.0.0.1:{datagrams.getsockname()[1]}")) as line:
        assert line.write(b"hello") == 5
        data, sender = datagrams.recvfrom(9)
        datagrams.sendto(data[::-1], sender)
        assert read_bytes(line, 5) == b"olleh"


def test_udpin_sends_to_the_last_sender(datagrams):
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with closing(NetworkLine(f"udpin:127.0.0.1:{port}")) as line:
        assert line.write(b"unused") == 0
        assert line.overrun_bytes == 6
        datagrams.sendto(b"here", ("127.0.0.1", port))
        assert read_bytes(line, 4) == b"here"
        line.write(b"there")
        assert datagrams.recv(9) == b"there"


@pytest.mark.parametrize("url", ["", "tcp:", "host:0", "host:1:2", "udpout:host:70000", "udpin:host:x"])
def test_invalid_url_is_rejected(url):
    with pytest.raises(NetworkLineError, match="write HOST"):
        NetworkLine(url)


def test_refused_connection_raises_an_error(datagrams):
    with pytest.raises(NetworkLineError, match="127"):
        NetworkLine(f"127.0.0.1:{datagrams.getsockname()[1]}")
