"""The URLs of links."""

import pytest

from firmware_py.link.wire.urls import LinkError, LinkUrl, parse_url


@pytest.mark.parametrize(
    ("text", "kind", "host", "number"),
    [
        ("udpout:127.0.0.1:14550", "udpout", "127.0.0.1", 14550),
        ("udpin:0.0.0.0:14550", "udpin", "0.0.0.0", 14550),
        ("udp:0.0.0.0:1", "udpin", "0.0.0.0", 1),
        ("tcpin:127.0.0.1:5760", "tcpin", "127.0.0.1", 5760),
        ("tcp:boat.local:65535", "tcpout", "boat.local", 65535),
        ("tcpout:10.0.0.1:5760", "tcpout", "10.0.0.1", 5760),
        ("serial:/dev/ttyS0:57600", "serial", "/dev/ttyS0", 57600),
        (
            "serial:/dev/serial/by-path/x-usb-0:1.2:1.0-port0:115200",
            "serial",
            "/dev/serial/by-path/x-usb-0:1.2:1.0-port0",
            115200,
        ),
    ],
)
def test_what_is_understood(text, kind, host, number):
    assert parse_url(text) == LinkUrl(kind, host, number, text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not a kind of link"),
        ("14550", "not a kind of link"),
        ("http://x:1", "not a kind of link"),
        ("udpout:127.0.0.1", "port is missing"),
        ("udpin:0.0.0.0:0000145509", "is not a port"),  # 145509, though its first nine digits are a port
        (f"udpin:0.0.0.0:000014550{'9' * 5000}", "is not a port"),
        ("udpout::14550", "port is missing"),
        ("udpin:0.0.0.0:0", "whole number from 1 to 65535"),
        ("udpin:0.0.0.0:65536", "whole number"),
        ("udpin:0.0.0.0:1e3", "whole number"),
        ("udpin:0.0.0.0:-5", "whole number"),
        ("udpin:0.0.0.0:\u0663", "whole number"),
        ("tcpin:h:99999999999999999999", "whole number"),
        ("serial:/dev/ttyS0", "baud rate is missing"),
        ("sbd:", "path is missing"),
        ("serial:/dev/ttyS0:fast", "whole number from 300"),
    ],
)
def test_what_is_not_understood_is_one_line_with_a_remedy(text, says):
    with pytest.raises(LinkError, match=says) as caught:
        parse_url(text)
    assert "use " in str(caught.value)
    assert "\n" not in str(caught.value)
