"""A link whose address is not to be had yet."""

import socket
import threading
from contextlib import closing

import pytest

from firmware_py.link.wire.open_transport import LateTransport, open_transport
from firmware_py.link.wire.transport_udp import UdpTransport
from firmware_py.link.wire.urls import LinkError, parse_url

PATIENCE_S = 30.0


@pytest.fixture
def taken():
    """A port that another program has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        yield holder


def url_of(holder):
    return f"udpin:127.0.0.1:{holder.getsockname()[1]}"


def test_who_does_not_wait_is_refused_and_who_waits_is_reported_why(taken):
    with pytest.raises(LinkError, match="already in use"):
        open_transport(url_of(taken), None)
    reports = []
    with closing(open_transport(url_of(taken), None, say=reports.append)) as link:
        assert (link.descriptors(), link.addresses(), link.connections()) == ((), (), ())
        assert not link.send("anybody", b"x")
        link.poll(0.0)
    (text,) = reports
    assert "already in use" in text
    assert text.endswith("; it is tried again")


def test_what_can_be_opened_is_opened_at_once():
    reports = []
    with closing(open_transport("udpout:127.0.0.1:14550", None, say=reports.append)) as link:
        assert isinstance(link, UdpTransport)
    assert reports == []


@pytest.mark.parametrize("url", ["udpin:127.0.0.1:99999", "pigeon:1", "udpin:127.0.0.1:1?policy=none"])
def test_a_url_that_says_nothing_is_refused_anyone_who_waits(url):
    with pytest.raises(LinkError):
        open_transport(url, None, say=print)


def test_it_is_the_link_from_when_it_can_be_opened():
    url, tried, found = parse_url("udpout:127.0.0.1:14550"), [], threading.Event()

    def open_now():
        tried.append(url)
        if len(tried) < 3:
            raise LinkError("not yet")
        found.set()
        return UdpTransport(url)

    with closing(LateTransport(url, open_now, retry_s=0.001)) as link:
        assert found.wait(PATIENCE_S)
        while link.opened is None:
            pass
        assert link.addresses() == link.opened.addresses() == (("127.0.0.1", 14550),)
        assert link.descriptors() == link.opened.descriptors()
        assert (link.name, link.options, link.datagrams) == (url.text, url.options, True)
    assert len(tried) == 3


def test_a_name_server_that_says_nothing_holds_up_no_peer(monkeypatch):
    monkeypatch.setattr("firmware_py.link.wire.open_transport.FIRST_TRY_S", 0.001)
    answer = threading.Event()

    def open_now():
        assert answer.wait(PATIENCE_S)
        return UdpTransport(parse_url("udpout:127.0.0.1:14550"))

    link = LateTransport(parse_url("udpout:station.example:14550"), open_now)
    assert link.opened is None
    assert "station.example" in link.problem
    link.close()
    answer.set()


@pytest.mark.parametrize(
    ("url", "exposed"),
    [("udpin:192.0.2.1:14550", True), ("tcpin:0.0.0.0:5760", True), ("tcpin:127.0.0.1:5760", False),
     ("tcpout:192.0.2.1:5760", False)],
)  # fmt: skip
def test_a_link_that_will_listen_to_others_wants_a_key_before_it_does(url, exposed):
    def open_now():
        raise LinkError("not yet")

    with closing(LateTransport(parse_url(url), open_now)) as link:
        assert link.exposed is exposed
