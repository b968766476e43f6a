"""NMEA 0183 output: listeners, rates, options of the URL."""

import math
import socket
from contextlib import closing

import pytest

from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.link.nmea import TABLE, NmeaData, open_output
from firmware_py.link.wire.urls import LinkError
from support.line import FakeLine
from support.link import SNAPSHOT
from support.program import unused_ports


def make_data():
    return NmeaData(SNAPSHOT, 1.79e9, math.radians(2.0))


@pytest.fixture
def listener():
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as made:
        made.bind(("127.0.0.1", 0))
        made.settimeout(30)
        yield made


@pytest.mark.parametrize(("rate", "count"), [("0.01", 1), ("10", 10), ("1", 1)])
def test_rate_is_from_one_in_100_s_to_10_hz(listener, rate, count):
    url = f"nmea:udpout:127.0.0.1:{listener.getsockname()[1]}?sentences=HDT&rate={rate}"
    with closing(open_output(url, None)) as output:
        for twentieth in range(20):
            output.publish(make_data, twentieth / 20.0)
        assert output.status(0.0).peers[0].sent_bytes == 18 * count


def test_line_may_be_used_completely():
    url = "nmea:serial:/dev/ttyX:1640?sentences=HDT,RMC"
    with closing(open_output(url, lambda *_: FakeLine())) as output:  # two sentences of 82 bytes
        assert output.status(0.0).url == url
    with pytest.raises(LinkError, match="164 bytes/s may be needed, and the line has 163"):
        open_output(url.replace("1640", "1630"), lambda *_: FakeLine())


@pytest.mark.parametrize("kind", ["udp", "udpout"])
def test_datagram_contains_the_selected_sentences_at_the_selected_rate(listener, kind):
    url = f"nmea:{kind}:127.0.0.1:{listener.getsockname()[1]}?sentences=RSA,HDT&rate=2"
    with closing(open_output(url, None)) as output:
        for tenth in range(10):
            output.publish(make_data, tenth / 10.0)
        assert listener.recv(2000).split(b"\r\n")[:-1] == [b"$AGRSA,11.5,A,,V*4A", b"$HCHDT,57.3,T*18"]
        reports = output.status(1.0)
        peer = PeerStatus("1 listening", False, True, False, None, 2 * (21 + 18), 0, 0)
        assert reports == LinkStatus(url, "NMEA 0183", (peer,))


def test_missed_intervals_are_skipped(listener):
    url = f"nmea:udpout:127.0.0.1:{listener.getsockname()[1]}"
    with closing(open_output(f"{url}?sentences={','.join(TABLE)}", None)) as output:
        output.publish(make_data, 0.0)
        once = output.status(0.0).peers[0].sent_bytes
        output.publish(make_data, 100.0)
        for now_s, count in ((100.9, 2), (101.0, 3), (101.9, 3), (102.0, 4), (104.0, 5), (104.5, 5)):
            output.publish(make_data, now_s)
            assert output.status(0.0).peers[0].sent_bytes == count * once


def test_several_tcp_listeners_receive_and_their_bytes_are_discarded():
    (port,) = unused_ports(["tcpin"])
    with closing(open_output(f"nmea:tcpin:127.0.0.1:{port}?sentences=HDT", None)) as output:
        clients = [socket.create_connection(("127.0.0.1", port), timeout=30) for _ in range(2)]
        for client in clients:
            client.sendall(b"$GPGLL,hello*00\r\n" * 50)
        for second in range(4):  # one is accepted at a time
            output.publish(make_data, float(second))
        assert output.status(0.0).peers[0].address == "2 listening"
        for client in clients:
            assert client.recv(18) == b"$HCHDT,57.3,T*18\r\n"
            client.close()
        for second in range(4, 8):
            output.publish(make_data, float(second))
        assert output.status(0.0).peers[0].address == "0 listening"


def test_full_line_drops_and_counts_complete_messages():
    line = FakeLine()
    with closing(open_output("nmea:serial:/dev/ttyX:4800?sentences=HDT", lambda *_: line)) as output:
        line.full = True
        output.publish(make_data, 0.0)
        line.full = False
        output.publish(make_data, 1.0)
        assert line.written == [b"$HCHDT,57.3,T*18\r\n"]
        assert output.status(0.0).peers[0].dropped == 1
        assert output.status(0.0).blocked_reason == ""
        line.connected = False
        assert output.status(0.0).blocked_reason == "the line is not there"


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("nmea:udpin:0.0.0.0:10110", "use nmea:udpout:"),
        ("nmea:unknown:0", "use nmea:udpout:"),
        ("nmea:udpout:127.0.0.1:10110?sentences=HDT,XYZ", "there are sentences=HDT,"),
        ("nmea:udpout:127.0.0.1:10110?rate=nan", "rate=0.01 to 10"),
        ("nmea:udpout:127.0.0.1:10110?rate=0.0099", "rate=0.01 to 10"),
        ("nmea:udpout:127.0.0.1:10110?rate=10.1", "rate=0.01 to 10"),
        ("nmea:udpout:127.0.0.1:10110?rate=-1", "rate=0.01 to 10"),
        ("nmea:udpout:127.0.0.1:10110?policy=open", "there are sentences="),
        ("nmea:udpout:127.0.0.1:99999", "not a port"),
        ("nmea:serial:/dev/ttyX:4800", "738 bytes/s may be needed, and the line has 480"),
    ],
)
def test_invalid_url_is_an_error_with_a_remedy(url, text):
    with pytest.raises(LinkError) as caught:
        open_output(url, lambda *_: FakeLine())
    assert text in str(caught.value)
