"""UDP on real loopback sockets."""

import select
import socket

import pytest

from firmware_py.link.wire.open_transport import open_transport
from firmware_py.link.wire.transport import LinkError


@pytest.fixture
def station():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        opened.settimeout(5.0)
        yield opened


@pytest.fixture
def opened():
    transports = []

    def opening(url):
        transports.append(open_transport(url, None))
        return transports[-1]

    yield opening
    for transport in transports:
        transport.close()


def receive(transport):
    (descriptor,) = transport.descriptors()
    assert select.select([descriptor], [], [], 5.0)[0]
    return transport.receive(descriptor)


def port_of(transport):
    return transport._socket.getsockname()[1]


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_udpout_sends_from_the_start_and_hears_the_answer(opened, station):
    transport = opened(f"udpout:127.0.0.1:{station.getsockname()[1]}")
    (target,) = transport.addresses()
    assert transport.send(target, b"hello")
    data, boat = station.recvfrom(100)
    assert data == b"hello"
    station.sendto(b"answer", boat)
    assert receive(transport) == [(target, b"answer")]


def test_udpout_hears_another_port_of_the_same_host_as_another_correspondent(opened, station):
    transport = opened("udpout:127.0.0.1:9")
    transport.send(transport.addresses()[0], b"x")
    station.sendto(b"hello", ("127.0.0.1", port_of(transport)))
    assert receive(transport) == [(station.getsockname(), b"hello")]


def test_udpout_does_not_hear_other_hosts(opened, station):
    transport = opened("udpout:127.0.0.2:9")
    transport.send(transport.addresses()[0], b"x")
    station.sendto(b"hello", ("127.0.0.1", port_of(transport)))
    assert receive(transport) == []


def test_nobody_listening_harms_nothing(opened):
    transport = opened(f"udpout:127.0.0.1:{free_port()}")
    for _ in range(5):
        assert transport.send(transport.addresses()[0], b"hello")
    transport.receive(transport.descriptors()[0])
    assert transport.send(transport.addresses()[0], b"hello")


def test_udpin_answers_whoever_speaks_and_reads_a_bounded_piece(opened, station):
    transport = opened(f"udpin:127.0.0.1:{free_port()}")
    assert transport.addresses() == ()
    for _ in range(100):
        station.sendto(b"x" * 500, ("127.0.0.1", port_of(transport)))
    heard = receive(transport)
    assert 1 <= len(heard) <= 48
    assert transport.send(heard[0][0], b"hello")
    assert station.recv(100) == b"hello"


def test_nothing_to_read_is_nothing(opened):
    transport = opened(f"udpin:127.0.0.1:{free_port()}")
    assert transport.receive(transport.descriptors()[0]) == []


def test_a_port_in_use_is_said_in_one_line(opened):
    first = opened(f"udpin:127.0.0.1:{free_port()}")
    with pytest.raises(LinkError, match=r"in use.*choose another port") as caught:
        open_transport(f"udpin:127.0.0.1:{port_of(first)}", None)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("url", ["udpout:no.such.host.invalid:1", "udpin:no.such.host.invalid:1", "udpout:.:1"])
def test_an_unknown_host_is_said(url):
    with pytest.raises(LinkError, match="is not known"):
        open_transport(url, None)


def test_an_address_that_is_not_ours_is_said():
    with pytest.raises(LinkError, match="an address of this machine"):
        open_transport("udpin:192.0.2.1:14550", None)


@pytest.mark.parametrize(
    ("kind", "host", "exposed"),
    [
        ("udpin", "127.0.0.1", False),
        ("udpin", "localhost", False),
        ("udpin", "0.0.0.0", True),
        ("tcpin", "127.0.0.1", False),
        ("tcpin", "0.0.0.0", True),
    ],
)
def test_what_other_computers_reach_is_known(opened, kind, host, exposed):
    assert opened(f"{kind}:{host}:{free_port()}").exposed is exposed


def test_correspondents_are_told_apart_by_port_and_counted_by_host(opened):
    assert opened(f"udpin:127.0.0.1:{free_port()}").host(("192.0.2.1", 5)) == "192.0.2.1"
