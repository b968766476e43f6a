"""URLs of links: their parts and options, and the addresses of the host they name."""

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

_SELF: Final = "localhost"


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
_USUAL_BAUD = {"sbd": "19200"}  # where the baud rate may be left away


class OptionError(ValueError):
    """An option of a link is wrong; the text says what is allowed."""


class Policy(Enum):
    """Rights of a frame that is not signed with the boat's key."""

    AUTO = "auto"  # OPEN without a key and on trusted links, otherwise SIGNED_COMMANDS
    OPEN = "open"
    SIGNED_COMMANDS = "signed-commands"  # it may read, but change nothing
    SIGNED_ONLY = "signed-only"  # it is ignored


class LinkClass(Enum):
    """Data rate and cost of a link."""

    FAST = "fast"
    RADIO = "radio"
    SATELLITE = "satellite"
    MESSAGES = "messages"  # paid messages by satellite: only for an sbd link


class LinkOptions(msgspec.Struct, frozen=True):
    """The options of one link.

    `trusted`: only the owner can reach it (a cable), so a signing key may be set over it. `link_class` None: by the
    kind of the link. `systems` are the MAVLink system ids that may command; None: all. `route`: messages between other
    systems are routed over it; None: by the class.
    """

    trusted: bool = False
    policy: Policy = Policy.AUTO
    link_class: LinkClass | None = None
    systems: frozenset[int] | None = None
    route: bool | None = None

    def at_radio_rates(self, *, usual: bool) -> bool:
        """Return whether telemetry is sent at the lower rates; `usual` is the default of the kind of link."""
        return usual if self.link_class is None else self.link_class is not LinkClass.FAST


PLAIN = LinkOptions()  # of a URL without options

_SWITCH: Mapping[str, bool] = {"1": True, "0": False, "true": True, "false": False, "yes": True, "no": False}
_POLICIES: Mapping[str, Policy] = {policy.value: policy for policy in Policy}
_CLASSES: Mapping[str, LinkClass] = {kind.value: kind for kind in LinkClass if kind is not LinkClass.MESSAGES}


def _systems(text: str) -> frozenset[int] | None:
    parts = text.split(",")
    if not all(part.isascii() and part.isdigit() and len(part) < 4 and 1 <= int(part) <= 255 for part in parts):
        return None
    return frozenset(int(part) for part in parts)


# name -> field, parser (None: not allowed), allowed values
_OPTIONS: Mapping[str, tuple[str, Callable[[str], object], str]] = {
    "trusted": ("trusted", _SWITCH.get, "1 or 0"),
    "policy": ("policy", _POLICIES.get, ", ".join(_POLICIES)),
    "class": ("link_class", _CLASSES.get, ", ".join(_CLASSES)),
    "route": ("route", _SWITCH.get, "1 or 0"),
    "systems": ("systems", _systems, "system ids from 1 to 255, with commas between them"),
}


def parse_options(text: str) -> LinkOptions:
    """Read `NAME=VALUE&NAME=VALUE`, or raise OptionError."""
    options = PLAIN
    names = set()
    for item in text.split("&"):
        name, _, value = item.partition("=")
        row = _OPTIONS.get(name)
        if row is None:
            near = difflib.get_close_matches(name, _OPTIONS, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(_OPTIONS)}"
            raise OptionError(f"option {abbreviate(name)} is not known; {hint}")
        if name in names:
            raise OptionError(f"option {name!r} is given twice; give it once")
        names.add(name)
        field, read, allowed = row
        setting = read(value)
        if setting is None:
            raise OptionError(f"option {name}={abbreviate(value)}: allowed are {allowed}")
        options = replace(options, **{field: setting})
    return options


class LinkError(ValueError):
    """A link cannot be opened; the text says why and what to do."""


class LinkUrl(msgspec.Struct, frozen=True):
    """A parsed URL; `host` and `number` are a port's path and baud rate for `serial` and `sbd`."""

    kind: str
    host: str
    number: int
    text: str
    options: LinkOptions = PLAIN


def parse_url(text: str) -> LinkUrl:
    """Read a link URL in pymavlink's style, perhaps with options behind a question mark, or raise LinkError."""
    link = f"link {text[:120]!r}"
    if "\0" in text:
        raise LinkError(f"{link}: it holds a NUL; use {_FORMS}")
    place, mark, query = text.partition("?")
    scheme, _, rest = place.partition(":")
    kind = _KINDS.get(scheme)
    if kind is None:
        raise LinkError(f"{link}: {abbreviate(scheme)} is not a kind of link; use {_FORMS}")
    # From the right: the paths of /dev/serial/by-path hold colons.
    host, _, number = rest.rpartition(":")
    if kind in _USUAL_BAUD and not number.isdigit():
        host, number = rest, _USUAL_BAUD[kind]
    what, low, high = ("baud rate", 300, 4_000_000) if kind in ("serial", "sbd") else ("port", 1, 65535)
    if not host:
        missing = "path" if kind in _USUAL_BAUD else what
        raise LinkError(f"{link}: the {missing} is missing; use {_FORMS}")
    if not (number.isascii() and number.isdigit() and len(number) < 10 and low <= int(number) <= high):
        raise LinkError(f"{link}: {abbreviate(number)} is not a {what}; use a whole number from {low} to {high}")
    if kind not in ("serial", "sbd") and ":" in host:
        raise LinkError(f"{link}: there is no IPv6 here; use an IPv4 address or a name that has one")
    try:
        options = parse_options(query) if mark else PLAIN
    except OptionError as error:
        raise LinkError(f"{link}: {error}") from None
    return LinkUrl(kind, host, int(number), text, options)


def resolve(url: LinkUrl) -> tuple[str, int]:
    """Return the first numeric IPv4 address of a URL, or raise LinkError. May wait for a name server."""
    try:
        return addresses_of(url)[0], url.number
    except (OSError, UnicodeError) as error:
        raise LinkError(f"link {url.text!r}: host {url.host!r} is not known ({error}); use its IPv4 address") from error


def addresses_of(url: LinkUrl) -> tuple[str, ...]:
    """Return the numeric IPv4 addresses of a URL, at least one, or raise OSError or UnicodeError."""
    found = socket.getaddrinfo(url.host, url.number, socket.AF_INET, socket.SOCK_DGRAM)
    return tuple(dict.fromkeys(str(address[4][0]) for address in found))


def is_numeric(host: str) -> bool:
    """Return whether a host is an IPv4 address."""
    try:
        ipaddress.IPv4Address(host)
    except ValueError:
        return False
    return True


class HostLookup:
    """Looks up a host name again on a thread; not for a numeric address.

    A name server may be silent for half a minute. The thread is started early, since one that is started later would
    inherit the priority of the loop.
    """

    def __init__(self, url: LinkUrl, every_s: float) -> None:
        """Take the URL, and the minimum interval of lookups."""
        self._url, self._every_s = url, every_s
        self.found: tuple[str, ...] = ()  # the addresses of the latest answer; none before the first
        self._asked_s: float | None = None
        self._wanted = threading.Event()
        self._ended = False
        if not is_numeric(url.host) and url.host != _SELF:
            threading.Thread(target=self._work, name="link names", daemon=True).start()

    def ask(self, now_s: float) -> None:
        """Start a lookup, unless the interval has not passed yet."""
        if self._asked_s is None or now_s - self._asked_s >= self._every_s:
            self._asked_s = now_s
            self._wanted.set()

    def close(self) -> None:
        """End the thread after its present lookup."""
        self._ended = True
        self._wanted.set()

    def _work(self) -> None:
        while True:
            self._wanted.wait()
            self._wanted.clear()
            if self._ended:
                return
            try:
                self.found = addresses_of(self._url)
            except (OSError, UnicodeError):
                continue  # the former address may still be valid
