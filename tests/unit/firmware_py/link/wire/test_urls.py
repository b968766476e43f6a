"""URLs of links and their options."""

import pytest

from firmware_py.link.wire.urls import (
    PLAIN,
    HostLookup,
    LinkClass,
    LinkError,
    LinkOptions,
    LinkUrl,
    OptionError,
    Policy,
    parse_options,
    parse_url,
    resolve,
)

BY_PATH = "/dev/serial/by-path/x-usb-0:1.2:1.0-port0"


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
        (f"serial:{BY_PATH}:115200", "serial", BY_PATH, 115200),
        ("serial:/dev/ttyS0:300", "serial", "/dev/ttyS0", 300),
        ("serial:/dev/ttyS0:4000000", "serial", "/dev/ttyS0", 4_000_000),
        ("sbd:/dev/ttyS0", "sbd", "/dev/ttyS0", 19200),
        ("sbd:/dev/ttyS0:9600", "sbd", "/dev/ttyS0", 9600),
    ],
)
def test_valid_url_is_parsed(text, kind, host, number):
    assert parse_url(text) == LinkUrl(kind, host, number, text)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "not a kind of link"),
        ("14550", "not a kind of link"),
        ("http://x:1", "not a kind of link"),
        ("udpout:127.0.0.1", "port is missing"),
        ("udpin:0.0.0.0:0000145509", "is not a port"),  # 145509, but the first nine digits are a valid port
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
        ("serial:/dev/ttyS0:299", "whole number from 300 to 4000000"),
        ("serial:/dev/ttyS0:4000001", "whole number from 300 to 4000000"),
    ],
)
def test_invalid_url_is_rejected_in_one_line_with_a_remedy(text, reason):
    with pytest.raises(LinkError, match=reason) as caught:
        parse_url(text)
    assert "use " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_all_options_are_parsed():
    url = parse_url("udpin:0.0.0.0:14550?trusted=1&policy=signed-commands&class=satellite&systems=255,250")
    assert (url.kind, url.host, url.number) == ("udpin", "0.0.0.0", 14550)
    assert url.options == LinkOptions(
        trusted=True, policy=Policy.SIGNED_COMMANDS, link_class=LinkClass.SATELLITE, systems=frozenset({255, 250})
    )


@pytest.mark.parametrize(
    ("text", "is_set"),
    [("1", True), ("true", True), ("yes", True), ("0", False), ("false", False), ("no", False)],
)
def test_switch_has_three_words_for_on_and_off(text, is_set):
    assert parse_options(f"trusted={text}&systems=1") == LinkOptions(trusted=is_set, systems=frozenset({1}))


def test_url_without_options_has_the_defaults():
    assert parse_url("serial:/dev/ttyS0:57600").options == PLAIN
    assert LinkOptions(trusted=False, policy=Policy.AUTO, link_class=None, systems=None) == PLAIN


@pytest.mark.parametrize(
    ("text", "rates"), [("class=fast", False), ("class=radio", True), ("class=satellite", True), ("trusted=no", None)]
)
def test_class_option_overrides_the_default_rates(text, rates):
    options = parse_options(text)
    for default in (False, True):
        assert options.uses_radio_rates(default=default) is (default if rates is None else rates)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "is not known; there are trusted, policy"),
        ("polcy=open", "did you mean 'policy'"),
        ("policy", "policy='': allowed are auto, open"),
        ("policy=signed", "allowed are auto, open, signed-commands, signed-only"),
        ("trusted=maybe", "allowed are 1 or 0"),
        ("trusted=1\n", "allowed are 1 or 0"),
        ("class=slow", "allowed are fast, radio, satellite"),
        ("systems=", "system ids from 1 to 255"),
        ("systems=0", "system ids from 1 to 255"),
        ("systems=256", "system ids from 1 to 255"),
        ("systems=0255", "system ids from 1 to 255"),
        ("systems=1,,2", "system ids from 1 to 255"),
        ("systems=\u0663", "system ids from 1 to 255"),
        ("systems=99999999999999999999", "system ids from 1 to 255"),
        (f"systems=0001{'9' * 5000}", "system ids from 1 to 255"),
        ("\1" * 5000, "is not known"),
        ("\0" * 5000, "is not known|contains a NUL"),  # a NUL is not allowed anywhere in a URL
        ("trusted=1&trusted=1", "given twice"),
        ("trusted=1&", "is not known"),
    ],
)
def test_invalid_option_is_rejected_in_one_line_with_the_allowed_values(text, reason):
    with pytest.raises(OptionError, match=reason):
        parse_options(text)
    with pytest.raises(LinkError, match=reason) as caught:
        parse_url(f"udpin:0.0.0.0:14550?{text}")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000


def test_numeric_host_needs_no_lookup(monkeypatch):
    """A lookup imports codecs and opens files; at the limit of open files it ended the start with a traceback."""
    monkeypatch.setattr("socket.getaddrinfo", None)
    assert resolve(parse_url("udpout:127.0.0.1:14550")) == ("127.0.0.1", 14550)


def test_lookups_have_a_minimum_interval(monkeypatch):
    requests = []
    monkeypatch.setattr("threading.Event.set", lambda _event: requests.append(None))
    lookup = HostLookup(parse_url("tcp:10.0.0.1:5760"), 30.0)  # without a thread
    counts = []
    for now_s in (100.0, 129.9, 130.0, 159.9, 160.1):
        lookup.start(now_s)
        counts.append(len(requests))
    assert counts == [1, 1, 2, 2, 3]


@pytest.mark.parametrize("error", [OSError("no answer"), UnicodeError("label too long"), LookupError("no codec")])
def test_failed_lookup_is_one_line_with_a_remedy(error, monkeypatch):
    def fail(*_arguments):
        raise error

    monkeypatch.setattr("socket.getaddrinfo", fail)
    with pytest.raises(LinkError, match=f"'boat.local' is not known \\({error}\\); use its IPv4 address"):
        resolve(parse_url("tcp:boat.local:5760"))
