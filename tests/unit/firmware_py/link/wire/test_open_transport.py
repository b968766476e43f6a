"""Serial lines, and sockets that cannot be opened immediately."""

import socket
import threading
from contextlib import closing
from types import SimpleNamespace

import pytest

from firmware_py.link.wire.open_transport import RetriedTransport, open_transport
from firmware_py.link.wire.transport_udp import UdpTransport
from firmware_py.link.wire.urls import PLAIN, LinkError, parse_url
from support.line import FakeLine
from support.link import MemoryTransport

TIMEOUT_S = 30.0


@pytest.fixture
def line():
    return FakeLine(name="/dev/ttyX")


@pytest.mark.parametrize(("baud", "is_radio"), [(9600, True), (57600, True), (115200, True), (115201, False)])
def test_serial_line_is_opened_with_its_baud_rate(line, baud, is_radio):
    calls = []
    transport = open_transport(f"serial:/dev/ttyX:{baud}", lambda path, rate: calls.append((path, rate)) or line)
    assert calls == [("/dev/ttyX", baud)]
    assert (transport.byte_rate, transport.has_radio_rates) == (baud / 10, is_radio)
    assert (transport.name, transport.options) == (f"serial:/dev/ttyX:{baud}", PLAIN)
    assert (transport.connections(), transport.host("line")) == ((), "line")


def test_serial_line_exchanges_bytes_until_it_is_unplugged(line):
    transport = open_transport("serial:/dev/ttyX:57600", lambda *_: line)
    (address,) = transport.addresses()
    line.inbox += b"in"
    assert transport.receive(7) == ((address, b"in"),)
    assert transport.receive(7) == ()
    assert transport.send(address, b"out")
    assert line.written == [b"out"]
    assert (transport.is_datagram, transport.is_exposed, transport.blocked_reason) == (False, False, "")
    line.unplug()
    assert transport.blocked_reason == "the line is not there"
    assert transport.descriptors() == ()
    assert not transport.send(address, b"out")


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcpin", "tcpout"])
@pytest.mark.parametrize(("query", "has_radio_rates"), [("", False), ("?class=radio&route=1", True)])
def test_socket_has_the_properties_of_its_url(closing_later, free_port, kind, query, has_radio_rates):
    url = f"{kind}:127.0.0.1:{free_port()}{query}"
    link = closing_later(open_transport(url, None))
    assert (link.name, link.options, link.byte_rate) == (url, parse_url(url).options, None)
    assert (link.has_radio_rates, link.is_datagram, link.is_exposed) == (has_radio_rates, kind.startswith("udp"), False)
    assert (link.blocked_reason, link.connections()) == ("", ())


@pytest.fixture
def occupied_url():
    """URL of a port that another socket uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        yield f"udpin:127.0.0.1:{other.getsockname()[1]}"


def test_occupied_port_is_an_error_or_with_retry_a_report(occupied_url):
    with pytest.raises(LinkError, match="already in use"):
        open_transport(occupied_url, None)
    reports = []
    with closing(open_transport(occupied_url, None, report_retry=reports.append)) as link:
        assert (link.descriptors(), link.addresses(), link.connections()) == ((), (), ())
        assert not link.send("station", b"x")
        assert (link.receive(100), link.host("station")) == ((), "station")
        assert "already in use" in link.blocked_reason
        link.poll(0.0)
        link.drop("station")
    (text,) = reports
    assert "already in use" in text
    assert text.endswith("; it is tried again")


def test_free_port_is_opened_at_once_without_a_report():
    reports = []
    with closing(open_transport("udpout:127.0.0.1:14550", None, report_retry=reports.append)) as link:
        assert isinstance(link, UdpTransport)
    assert reports == []


@pytest.mark.parametrize("url", ["udpin:127.0.0.1:99999", "unknown:1", "udpin:127.0.0.1:1?policy=none"])
def test_invalid_url_is_an_error_even_with_retry(url):
    with pytest.raises(LinkError):
        open_transport(url, None, report_retry=print)


def test_retried_transport_delegates_after_it_is_opened():
    url, attempts, is_opened = parse_url("udpout:127.0.0.1:14550"), [], threading.Event()

    def open_now():
        attempts.append(url)
        if len(attempts) < 3:
            raise LinkError("not yet")
        is_opened.set()
        return UdpTransport(url)

    with closing(RetriedTransport(url, open_now, retry_s=0.001)) as link:
        assert is_opened.wait(TIMEOUT_S)
        while link.opened is None:
            pass
        assert link.addresses() == link.opened.addresses() == (("127.0.0.1", 14550),)
        assert link.descriptors() == link.opened.descriptors()
        assert (link.name, link.options, link.is_datagram) == (url.text, url.options, True)
        assert (link.has_radio_rates, link.byte_rate, link.connections(), link.blocked_reason) == (False, None, (), "")
        assert link.host(("127.0.0.1", 14550)) == "127.0.0.1"
    assert len(attempts) == 3


def test_every_call_is_passed_on_to_the_opened_transport():
    opened = MemoryTransport(addresses=(), options=PLAIN)
    opened.connected, opened.inbox, opened.blocked_reason = ("client",), [("client", b"in")], "no route"
    link = RetriedTransport(parse_url("udpin:127.0.0.1:14550"), lambda: opened, 0.001)
    assert (link.descriptors(), link.addresses(), link.connections()) == ((100,), (), ("client",))
    assert link.receive(100) == [("client", b"in")]
    assert link.send("client", b"out")
    assert opened.sent == [("client", b"out")]
    opened.is_writable = False
    assert not link.send("client", b"out")
    assert (link.blocked_reason, link.host(("192.0.2.1", 5))) == ("no route", "192.0.2.1")
    link.poll(5.0)
    link.drop("client")
    assert (opened.polled_s, opened.dropped) == (5.0, ["client"])
    link.close()
    assert opened.closed


def test_opening_is_tried_every_five_seconds_and_the_caller_waits_for_one(monkeypatch, occupied_url):
    waits_s = []

    class ClosedAfterThreeWaits(threading.Event):
        def wait(self, timeout_s):
            waits_s.append(timeout_s)
            if len(waits_s) == 3:
                self.set()

    class ImmediateThread:
        def __init__(self, *, target, name, daemon):
            assert (name, daemon) == ("link", True)  # a name server must not delay the end of the program
            self.start = target

    simulated = SimpleNamespace(Event=ClosedAfterThreeWaits, Thread=ImmediateThread)
    monkeypatch.setattr("firmware_py.link.wire.open_transport.threading", simulated)
    open_transport(occupied_url, None, report_retry=[].append)
    assert waits_s == [5.0, 5.0, 5.0, 1.0]


def test_silent_name_server_does_not_block_the_caller(monkeypatch):
    monkeypatch.setattr("firmware_py.link.wire.open_transport.MAX_FIRST_WAIT_S", 0.001)
    reply = threading.Event()

    def open_now():
        assert reply.wait(TIMEOUT_S)
        return UdpTransport(parse_url("udpout:127.0.0.1:14550"))

    before = set(threading.enumerate())
    link = RetriedTransport(parse_url("udpout:station.example:14550"), open_now, 0.001)
    (thread,) = set(threading.enumerate()) - before
    assert link.opened is None
    assert "station.example" in link.problem
    link.close()
    reply.set()
    thread.join(TIMEOUT_S)
    assert link.opened.descriptors() == (-1,)  # closed again


@pytest.mark.parametrize(
    ("url", "is_exposed"),
    [("udpin:192.0.2.1:14550", True), ("tcpin:0.0.0.0:5760", True), ("tcpin:127.0.0.1:5760", False),
     ("tcpout:192.0.2.1:5760", False)],
)  # fmt: skip
def test_unopened_transport_is_exposed_if_other_computers_will_reach_it(url, is_exposed):
    def open_now():
        raise LinkError("not yet")

    with closing(RetriedTransport(parse_url(url), open_now, 0.001)) as link:
        assert link.is_exposed is is_exposed
