"""UDP on real loopback sockets."""

import errno
import os
import select
import socket
import threading
import time
from contextlib import closing

import pytest

from firmware_py.link.wire.open_transport import open_transport
from firmware_py.link.wire.urls import LinkError


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


@pytest.mark.parametrize("kind", ["udpout", "udpin"])
def test_routers_may_take_a_datagram_apart(opened, kind):
    ip_mtu_discover, ip_pmtudisc_dont = 10, 0
    used = opened(f"{kind}:127.0.0.1:{free_port()}")._socket
    assert used.getsockopt(socket.IPPROTO_IP, ip_mtu_discover) == ip_pmtudisc_dont


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


class NoWay:
    """A socket of a system that refuses what is to be sent."""

    def __init__(self, socket_, number):
        self._socket, self.number = socket_, number

    def sendto(self, data, address):
        if self.number:
            raise OSError(self.number, os.strerror(self.number))
        return self._socket.sendto(data, address)

    def __getattr__(self, name):
        return getattr(self._socket, name)


@pytest.mark.parametrize("number", [errno.ENETUNREACH, errno.EPERM, errno.ENOBUFS, errno.EHOSTUNREACH])
def test_what_the_system_refuses_has_not_left_and_is_reported_until_something_does(opened, station, number):
    transport = opened(f"udpout:127.0.0.1:{station.getsockname()[1]}")
    (target,) = transport.addresses()
    transport._socket = NoWay(transport._socket, number)
    assert not transport.send(target, b"lost")
    assert transport.blocked_reason == os.strerror(number).lower()
    transport._socket.number = 0
    assert transport.send(target, b"hello")
    assert station.recvfrom(100)[0] == b"hello"
    assert transport.blocked_reason == ""


def test_that_a_stranger_cannot_be_reached_says_nothing_of_the_link(opened):
    transport = opened(f"udpin:127.0.0.1:{free_port()}")
    transport._socket = NoWay(transport._socket, errno.EACCES)
    assert not transport.send(("127.0.0.1", 9), b"lost")
    assert transport.blocked_reason == ""


def test_no_peer_listening_harms_nothing(opened):
    transport = opened(f"udpout:127.0.0.1:{free_port()}")
    for _ in range(5):
        assert transport.send(transport.addresses()[0], b"hello")
    transport.receive(transport.descriptors()[0])
    assert transport.send(transport.addresses()[0], b"hello")


def test_udpin_answers_anyone_who_speaks_and_reads_a_bounded_piece(opened, station):
    transport = opened(f"udpin:127.0.0.1:{free_port()}")
    assert transport.addresses() == ()
    for _ in range(100):
        station.sendto(b"x" * 500, ("127.0.0.1", port_of(transport)))
    received = receive(transport)
    assert 1 <= len(received) <= 48
    assert transport.send(received[0][0], b"hello")
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


def test_correspondents_are_reported_apart_by_port_and_counted_by_host(opened):
    assert opened(f"udpin:127.0.0.1:{free_port()}").host(("192.0.2.1", 5)) == "192.0.2.1"


@pytest.mark.parametrize("host", ["255.255.255.255", "127.255.255.255", "239.1.1.1", "0.0.0.0"])
def test_a_target_of_many_is_refused_since_anyone_who_answers_has_another_address(host):
    with pytest.raises(LinkError, match=rf"{host} is not the address of one station.*udpin:0\.0\.0\.0:14550"):
        open_transport(f"udpout:{host}:14550", None)


def test_who_waits_for_links_waits_for_none_that_can_never_be():
    with pytest.raises(LinkError, match="is not the address of one station"):
        open_transport("udpout:255.255.255.255:14550", None, say=print)


def test_what_need_not_hear_sends_to_a_whole_network():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plotter:
        plotter.bind(("127.255.255.255", 0))
        plotter.settimeout(5.0)
        with closing(
            open_transport(f"udpout:127.255.255.255:{plotter.getsockname()[1]}", None, receives=False)
        ) as link:
            link.send(link.addresses()[0], b"$GNRMC")
            assert plotter.recv(100) == b"$GNRMC"


@pytest.mark.parametrize("url", ["udpout:[::1]:14550", "udpin:::1:14550", "tcpin:[::]:5760", "tcpout:fe80::1:5760"])
def test_ipv6_is_refused_and_said_anyone_who_waits(url):
    with pytest.raises(LinkError, match="there is no IPv6 here; use an IPv4 address"):
        open_transport(url, None, say=print)


class NameServer:
    """Says where hosts are; `asked` counts."""

    def __init__(self, monkeypatch, *addresses):
        self.addresses, self.query = addresses, 0
        monkeypatch.setattr("firmware_py.link.wire.urls.addresses_of", self.answer)

    def answer(self, _url):
        self.query += 1
        if not self.addresses:
            raise OSError("no answer")
        return self.addresses


def polled(transport, seconds, until):
    """Poll a transport through the time of a voyage, and wait for the thread that asks."""
    for now_s in seconds:
        transport.poll(float(now_s))
        end = time.monotonic() + 5.0
        while not until() and time.monotonic() < end and now_s == seconds[-1]:
            transport.poll(float(now_s))
    assert until()


def test_a_silent_target_is_looked_up_again_and_followed(opened, monkeypatch):
    names = NameServer(monkeypatch, "127.0.0.2")
    transport = opened("udpout:station.example:14550")
    names.addresses = ("127.0.0.3", "127.0.0.4")
    polled(transport, range(61), lambda: transport.addresses() == (("127.0.0.3", 14550),))
    names.addresses = ("127.0.0.4", "127.0.0.3")  # in turns: it is still there
    query = names.query
    polled(transport, range(61, 122), lambda: names.query > query)
    transport.poll(121.5)
    names.addresses = ()
    query = names.query
    polled(transport, range(122, 183), lambda: names.query > query)
    assert transport.addresses() == (("127.0.0.3", 14550),)


def test_a_target_that_is_heard_or_has_no_name_is_not_looked_up(opened, monkeypatch, station):
    names = NameServer(monkeypatch, "127.0.0.1")
    transport = opened("udpout:station.example:9")
    transport.send(transport.addresses()[0], b"x")
    names.addresses = ("127.0.0.2",)
    for now_s in range(300):
        station.sendto(b"hello", ("127.0.0.1", port_of(transport)))
        receive(transport)
        transport.poll(float(now_s))
    assert names.query == 1  # as it was opened
    for url in ("udpout:127.0.0.1:14550", "udpout:localhost:14550"):
        other = opened(url)
        before = threading.active_count()
        for now_s in range(300):
            other.poll(float(now_s))
        assert threading.active_count() == before
