"""UDP over loopback sockets."""

import errno
import os
import select
import socket
import threading
import time
from pathlib import Path

import pytest

from firmware_py.link.wire.open_transport import open_transport
from firmware_py.link.wire.urls import LinkError

LOCALHOST = "127.0.0.1"


@pytest.fixture
def station(closing_later):
    opened = closing_later(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    opened.bind((LOCALHOST, 0))
    opened.settimeout(5.0)
    return opened


@pytest.fixture
def open_udp(closing_later):
    return lambda url: closing_later(open_transport(url, None))


@pytest.fixture
def udpin(open_udp, free_port):
    return open_udp(f"udpin:{LOCALHOST}:{free_port(socket.SOCK_DGRAM)}")


@pytest.fixture
def udpout(open_udp, station):
    return open_udp(f"udpout:{LOCALHOST}:{station.getsockname()[1]}")


def receive(transport):
    (descriptor,) = transport.descriptors()
    assert select.select([descriptor], [], [], 5.0)[0]
    return transport.receive(descriptor)


def port_of(transport):
    return transport._socket.getsockname()[1]


def test_udpout_sends_first_and_receives_the_reply(udpout, station):
    (target,) = udpout.addresses()
    assert udpout.send(target, b"hello")
    data, boat = station.recvfrom(100)
    assert data == b"hello"
    station.sendto(b"answer", boat)
    assert receive(udpout) == [(target, b"answer")]
    station.sendto(bytes(2100), boat)
    assert len(receive(udpout)[0][1]) == 2048


@pytest.mark.parametrize("kind", ["udpout", "udpin"])
def test_datagrams_may_be_fragmented_and_many_may_wait(request, kind):
    ip_mtu_discover, ip_pmtudisc_dont = 10, 0
    used = request.getfixturevalue(kind)._socket
    assert used.getsockopt(socket.IPPROTO_IP, ip_mtu_discover) == ip_pmtudisc_dont
    largest = int(Path("/proc/sys/net/core/wmem_max").read_text())
    # The system doubles the size.
    assert used.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) == 2 * min(262_144, largest)


@pytest.mark.parametrize(("target", "is_received"), [("127.0.0.1", True), ("127.0.0.2", False)])
def test_udpout_receives_from_all_ports_of_its_target_host_only(open_udp, station, target, is_received):
    transport = open_udp(f"udpout:{target}:9")
    transport.send(transport.addresses()[0], b"x")
    station.sendto(b"hello", (LOCALHOST, port_of(transport)))
    assert receive(transport) == ([(station.getsockname(), b"hello")] if is_received else [])


class RefusingSocket:
    """Socket whose sendto raises OSError with `number`, unless that is 0."""

    def __init__(self, socket_, number):
        self._socket, self.number = socket_, number

    def sendto(self, data, address):
        if self.number:
            raise OSError(self.number, os.strerror(self.number))
        return self._socket.sendto(data, address)

    def __getattr__(self, name):
        return getattr(self._socket, name)


@pytest.mark.parametrize("number", [errno.ENETUNREACH, errno.EPERM, errno.ENOBUFS, errno.EHOSTUNREACH])
def test_refused_datagram_is_reported_until_one_is_sent(udpout, station, number):
    (target,) = udpout.addresses()
    udpout._socket = RefusingSocket(udpout._socket, number)
    assert not udpout.send(target, b"lost")
    assert udpout.blocked_reason == os.strerror(number).lower()
    udpout._socket.number = 0
    assert udpout.send(target, b"hello")
    assert station.recvfrom(100)[0] == b"hello"
    assert udpout.blocked_reason == ""


def test_refused_datagram_to_another_peer_is_not_reported(udpin):
    udpin._socket = RefusingSocket(udpin._socket, errno.EACCES)
    assert not udpin.send((LOCALHOST, 9), b"lost")
    assert udpin.blocked_reason == ""


def test_port_without_listener_does_not_block_sending(open_udp, free_port):
    transport = open_udp(f"udpout:{LOCALHOST}:{free_port(socket.SOCK_DGRAM)}")
    for _ in range(5):
        assert transport.send(transport.addresses()[0], b"hello")
    transport.receive(transport.descriptors()[0])
    assert transport.send(transport.addresses()[0], b"hello")


def test_udpin_replies_to_any_sender_and_reads_a_limited_number_of_datagrams(udpin, station):
    assert udpin.addresses() == ()
    assert udpin.receive(udpin.descriptors()[0]) == []
    for _ in range(100):
        station.sendto(b"x" * 500, (LOCALHOST, port_of(udpin)))
    received = receive(udpin)
    assert len(received) == 48
    assert udpin.send(received[0][0], b"hello")
    assert station.recv(100) == b"hello"


def test_occupied_port_is_an_error_in_one_line(udpin):
    with pytest.raises(LinkError, match=r"in use.*choose another port") as caught:
        open_transport(f"udpin:{LOCALHOST}:{port_of(udpin)}", None)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("url", ["udpout:no.such.host.invalid:1", "udpin:no.such.host.invalid:1", "udpout:.:1"])
def test_unknown_host_is_an_error(url):
    with pytest.raises(LinkError, match="is not known"):
        open_transport(url, None)


def test_address_of_another_machine_is_an_error():
    with pytest.raises(LinkError, match="an address of this machine"):
        open_transport("udpin:192.0.2.1:14550", None)


@pytest.mark.parametrize(
    ("kind", "host", "is_exposed"),
    [
        ("udpin", "127.0.0.1", False),
        ("udpin", "localhost", False),
        ("udpin", "0.0.0.0", True),
        ("tcpin", "127.0.0.1", False),
        ("tcpin", "0.0.0.0", True),
    ],
)
def test_transport_is_exposed_unless_bound_to_loopback(open_udp, free_port, kind, host, is_exposed):
    assert open_udp(f"{kind}:{host}:{free_port()}").is_exposed is is_exposed


def test_host_of_a_peer_is_its_ip_address(udpin):
    assert udpin.host(("192.0.2.1", 5)) == "192.0.2.1"


@pytest.mark.parametrize("host", ["255.255.255.255", "127.255.255.255", "239.1.1.1", "0.0.0.0"])
def test_group_address_as_target_is_an_error(host):
    with pytest.raises(LinkError, match=rf"{host} is not the address of one station.*udpin:0\.0\.0\.0:14550"):
        open_transport(f"udpout:{host}:14550", None)


def test_group_address_as_target_is_not_retried():
    with pytest.raises(LinkError, match="is not the address of one station"):
        open_transport("udpout:255.255.255.255:14550", None, report_retry=print)


@pytest.mark.parametrize("retry", [None, print])
def test_output_without_input_may_have_any_target(closing_later, retry):
    link = closing_later(open_transport("udpout:255.255.255.255:9", None, receives=False, report_retry=retry))
    assert link.addresses() == (("255.255.255.255", 9),)


def test_output_without_input_may_send_to_a_broadcast_address(closing_later):
    plotter = closing_later(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    plotter.bind(("127.255.255.255", 0))
    plotter.settimeout(5.0)
    url = f"udpout:127.255.255.255:{plotter.getsockname()[1]}"
    link = closing_later(open_transport(url, None, receives=False))
    link.send(link.addresses()[0], b"$GNRMC")
    assert plotter.recv(100) == b"$GNRMC"


@pytest.mark.parametrize("url", ["udpout:[::1]:14550", "udpin:::1:14550", "tcpin:[::]:5760", "tcpout:fe80::1:5760"])
def test_ipv6_is_an_error_and_not_retried(url):
    with pytest.raises(LinkError, match="IPv6 is not supported; use an IPv4 address"):
        open_transport(url, None, report_retry=print)


class NameServer:
    """Replaces the lookup of host names; `queries` counts."""

    def __init__(self, monkeypatch, *addresses):
        self.addresses, self.queries = addresses, 0
        monkeypatch.setattr("firmware_py.link.wire.urls.addresses_of", self.look_up)

    def look_up(self, _url):
        self.queries += 1
        if isinstance(self.addresses, Exception):
            raise self.addresses
        return self.addresses


def poll(transport, times_s, until):
    """Poll at simulated times; at the last one, wait for the lookup thread until the condition is met."""
    for now_s in times_s:
        transport.poll(float(now_s))
    end_s = time.monotonic() + 5.0
    while not until() and time.monotonic() < end_s:
        transport.poll(float(times_s[-1]))
    assert until()


def test_silent_target_is_looked_up_again(open_udp, monkeypatch):
    names = NameServer(monkeypatch, "127.0.0.2")
    transport = open_udp("udpout:station.example:14550")
    names.addresses = ("127.0.0.3", "127.0.0.4")
    poll(transport, range(61), lambda: transport.addresses() == (("127.0.0.3", 14550),))
    # The address is kept while it is valid, and during any failure.
    results = [("127.0.0.4", "127.0.0.3"), OSError("no answer"), LookupError("unknown encoding: idna"), OSError()]
    for start_s, result in zip((61, 122, 183, 244), results, strict=True):
        names.addresses, queries = result, names.queries
        poll(transport, range(start_s, start_s + 61), lambda queries=queries: names.queries > queries)
        transport.poll(start_s + 60.5)
    assert transport.addresses() == (("127.0.0.3", 14550),)


@pytest.mark.parametrize("kind", ["udpout", "tcpout"])
def test_lookup_thread_ends_with_the_transport(monkeypatch, kind):
    names, before = NameServer(monkeypatch, "127.0.0.2"), set(threading.enumerate())
    transport = open_transport(f"{kind}:station.example:14550", None)
    (thread,) = set(threading.enumerate()) - before
    assert thread.daemon
    transport.close()
    thread.join(5.0)
    assert not thread.is_alive()
    assert names.queries == 1
    assert all(descriptor < 0 for descriptor in transport.descriptors())


def test_target_that_sends_or_has_no_name_is_not_looked_up(open_udp, monkeypatch, station):
    names = NameServer(monkeypatch, "127.0.0.1")
    transport = open_udp("udpout:station.example:9")
    transport.send(transport.addresses()[0], b"x")
    names.addresses = ("127.0.0.2",)
    for now_s in range(300):
        station.sendto(b"hello", (LOCALHOST, port_of(transport)))
        receive(transport)
        transport.poll(float(now_s))
    assert names.queries == 1  # when it was opened
    for url in ("udpout:127.0.0.1:14550", "udpout:localhost:14550"):
        threads = threading.active_count()
        other = open_udp(url)
        for now_s in range(300):
            other.poll(float(now_s))
        assert threading.active_count() == threads
