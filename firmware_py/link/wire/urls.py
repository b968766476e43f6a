"""URLs of links: syntax, options, and lookup of the host name."""

from __future__ import annotations

import difflib
import ipaddress
import socket
import threading
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.reading_notes import abbreviate

_LOCALHOST: Final = "localhost"

_FORMS = "udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT, serial:PATH:BAUD or sbd:PATH"
_KINDS = {
    "udpout": "udpout",
    "udpin": "udpin",
    "udp": "udpin",  # as in pymavlink
    "tcpin": "tcpin",
    "tcpout": "tcpout",
    "tcp": "tcpout",  # as in pymavlink
    "serial": "serial",
    "sbd": "sbd",
}
_DEFAULT_BAUD = {"sbd": "19200"}  # of the kinds of link with an optional baud rate


class OptionError(ValueError):
    """An option of a link is invalid; the text states the allowed values."""


class Policy(Enum):
    """Rights of a frame that is not signed with the boat's key."""

    AUTO = "auto"  # OPEN without a key and on trusted links, otherwise SIGNED_COMMANDS
    OPEN = "open"
    SIGNED_COMMANDS = "signed-commands"  # read only
    SIGNED_ONLY = "signed-only"  # none: the frame is ignored


class LinkClass(Enum):
    """Data rate and cost of a link."""

    FAST = "fast"
    RADIO = "radio"
    SATELLITE = "satellite"
    MESSAGES = "messages"  # paid messages by satellite; only of an sbd link


class LinkOptions(msgspec.Struct, frozen=True):
    """Options of one link.

    `trusted`: only the owner can reach the link (a cable), so a signing key may be set over it. `link_class`: None
    selects the class by the kind of link. `systems`: MAVLink system ids that may command; None allows all. `route`:
    whether messages between other systems are routed over the link; None decides by the class.
    """

    trusted: bool = False
    policy: Policy = Policy.AUTO
    link_class: LinkClass | None = None
    systems: frozenset[int] | None = None
    route: bool | None = None

    def uses_radio_rates(self, *, default: bool) -> bool:
        """Return whether telemetry is sent at the lower rates; `default` applies without a class."""
        return default if self.link_class is None else self.link_class is not LinkClass.FAST


PLAIN = LinkOptions()  # of a URL without options

_SWITCH: Mapping[str, bool] = {"1": True, "0": False, "true": True, "false": False, "yes": True, "no": False}
_POLICIES: Mapping[str, Policy] = {policy.value: policy for policy in Policy}
_CLASSES: Mapping[str, LinkClass] = {kind.value: kind for kind in LinkClass if kind is not LinkClass.MESSAGES}


def _parse_systems(text: str) -> frozenset[int] | None:
    ids = text.split(",")
    if not all(digits.isascii() and digits.isdigit() and len(digits) < 4 and 1 <= int(digits) <= 255 for digits in ids):
        return None
    return frozenset(map(int, ids))


# Name: field, parser that returns None for a value that is not allowed, description of the allowed values.
_OPTIONS: Mapping[str, tuple[str, Callable[[str], object], str]] = {
    "trusted": ("trusted", _SWITCH.get, "1 or 0"),
    "policy": ("policy", _POLICIES.get, ", ".join(_POLICIES)),
    "class": ("link_class", _CLASSES.get, ", ".join(_CLASSES)),
    "route": ("route", _SWITCH.get, "1 or 0"),
    "systems": ("systems", _parse_systems, "system ids from 1 to 255, with commas between them"),
}


def parse_options(text: str) -> LinkOptions:
    """Parse `NAME=VALUE&NAME=VALUE`; raise OptionError for an unknown, repeated or invalid option."""
    options = PLAIN
    names = set()
    for item in text.split("&"):
        name, _, value = item.partition("=")
        row = _OPTIONS.get(name)
        if row is None:
            similar = difflib.get_close_matches(name, _OPTIONS, 1)
            hint = f"did you mean {similar[0]!r}?" if similar else f"there are {', '.join(_OPTIONS)}"
            raise OptionError(f"option {abbreviate(name)} is not known; {hint}")
        if name in names:
            raise OptionError(f"option {name!r} is given twice; give it once")
        names.add(name)
        field, parse, allowed = row
        setting = parse(value)
        if setting is None:
            raise OptionError(f"option {name}={abbreviate(value)}: allowed are {allowed}")
        options = replace(options, **{field: setting})
    return options


class LinkError(ValueError):
    """A link cannot be opened; the text states the reason and the remedy."""


class LinkUrl(msgspec.Struct, frozen=True):
    """Parsed URL. `host` and `number` are host and port, or path and baud rate of `serial` and `sbd`."""

    kind: str
    host: str
    number: int
    text: str
    options: LinkOptions = PLAIN


def parse_url(text: str) -> LinkUrl:
    """Parse a link URL in the style of pymavlink with optional `?OPTIONS`; raise LinkError if it is invalid."""
    link = f"link {text[:120]!r}"
    if "\0" in text:
        raise LinkError(f"{link}: it contains a NUL; use {_FORMS}")
    location, mark, query = text.partition("?")
    scheme, _, rest = location.partition(":")
    kind = _KINDS.get(scheme)
    if kind is None:
        raise LinkError(f"{link}: {abbreviate(scheme)} is not a kind of link; use {_FORMS}")
    # Split at the last colon, since the paths of /dev/serial/by-path contain colons.
    host, _, number = rest.rpartition(":")
    if kind in _DEFAULT_BAUD and not number.isdigit():
        host, number = rest, _DEFAULT_BAUD[kind]
    quantity, low, high = ("baud rate", 300, 4_000_000) if kind in ("serial", "sbd") else ("port", 1, 65535)
    if not host:
        missing = "path" if kind in _DEFAULT_BAUD else quantity
        raise LinkError(f"{link}: the {missing} is missing; use {_FORMS}")
    if not (number.isascii() and number.isdigit() and len(number) < 10 and low <= int(number) <= high):
        raise LinkError(f"{link}: {abbreviate(number)} is not a {quantity}; use a whole number from {low} to {high}")
    if kind not in ("serial", "sbd") and ":" in host:
        raise LinkError(f"{link}: IPv6 is not supported; use an IPv4 address or a name that has one")
    try:
        options = parse_options(query) if mark else PLAIN
    except OptionError as error:
        raise LinkError(f"{link}: {error}") from None
    return LinkUrl(kind, host, int(number), text, options)


# Python raises LookupError if it cannot load the codec of host names, for example without a free file descriptor.
HOST_ERRORS = (OSError, UnicodeError, LookupError)


def resolve(url: LinkUrl) -> tuple[str, int]:
    """Return the first numeric IPv4 address and the port of a URL; raise LinkError for an unknown host. May block."""
    try:
        return addresses_of(url)[0], url.number
    except HOST_ERRORS as error:
        raise LinkError(f"link {url.text!r}: host {url.host!r} is not known ({error}); use its IPv4 address") from error


def addresses_of(url: LinkUrl) -> tuple[str, ...]:
    """Return the numeric IPv4 addresses of a URL, at least one; raise one of HOST_ERRORS for an unknown host."""
    if is_numeric(url.host):  # needs neither a name server nor files, of which a process may have no more
        return (url.host,)
    infos = socket.getaddrinfo(url.host, url.number, socket.AF_INET, socket.SOCK_DGRAM)
    return tuple(dict.fromkeys(str(info[4][0]) for info in infos))


def is_numeric(host: str) -> bool:
    """Return whether a host is an IPv4 address."""
    try:
        ipaddress.IPv4Address(host)
    except ValueError:
        return False
    return True


class HostLookup:
    """Lookup of a host name on a thread. It does nothing for a numeric address and for localhost.

    A lookup may take half a minute. The constructor starts the thread, since a thread that starts later would inherit
    the priority of the loop.
    """

    def __init__(self, url: LinkUrl, min_interval_s: float) -> None:
        """Start the thread; `min_interval_s` is the minimum interval of lookups."""
        self._url, self._min_interval_s = url, min_interval_s
        self.addresses: tuple[str, ...] = ()  # of the latest successful lookup
        self._started_s: float | None = None
        self._request = threading.Event()
        self._is_closed = False
        if not is_numeric(url.host) and url.host != _LOCALHOST:
            threading.Thread(target=self._look_up, name="link names", daemon=True).start()

    def start(self, now_s: float) -> None:
        """Start a lookup, unless the latest one was started less than the minimum interval ago."""
        if self._started_s is None or now_s - self._started_s >= self._min_interval_s:
            self._started_s = now_s
            self._request.set()

    def close(self) -> None:
        """End the thread after its present lookup."""
        self._is_closed = True
        self._request.set()

    def _look_up(self) -> None:
        while True:
            self._request.wait()
            self._request.clear()
            if self._is_closed:
                return
            try:
                self.addresses = addresses_of(self._url)
            except HOST_ERRORS:
                continue  # the former address may still be valid
