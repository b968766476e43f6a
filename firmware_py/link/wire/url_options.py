"""What a link's URL says behind its question mark: `udpin:0.0.0.0:14550?policy=signed-commands&systems=255,250`."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from enum import Enum

import msgspec
from msgspec.structs import replace

from firmware_py.common.reading_notes import shown


class OptionError(ValueError):
    """An option of a link is wrong; the text says what is allowed."""


class Policy(Enum):
    """What a frame may do that is not signed with the boat's key."""

    AUTO = "auto"  # OPEN until there is a key and on trusted links, else SIGNED_COMMANDS
    OPEN = "open"
    SIGNED_COMMANDS = "signed-commands"  # read, but change nothing
    SIGNED_ONLY = "signed-only"  # nothing: it is as if it had not come


class LinkClass(Enum):
    """How much the link carries, and what that costs."""

    FAST = "fast"
    RADIO = "radio"
    SATELLITE = "satellite"
    MESSAGES = "messages"  # of a satellite, each paid for: that of an sbd link, and of no other


class LinkOptions(msgspec.Struct, frozen=True):
    """The options of one link.

    `trusted`: nobody but the owner can reach it (a cable), so that a signing key may be
    set over it. `link_class` None is what the kind of the link suggests. `systems` are
    the MAVLink system ids that may command; None is all of them. `route`: messages between
    others pass over it; None is as the class suggests.
    """

    trusted: bool = False
    policy: Policy = Policy.AUTO
    link_class: LinkClass | None = None
    systems: frozenset[int] | None = None
    route: bool | None = None

    def at_radio_rates(self, *, usual: bool) -> bool:
        """Return whether telemetry goes out at the lower rates; `usual` is what the kind of the link suggests."""
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


# name -> the field, how its text is read (None: not allowed), what is allowed
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
            raise OptionError(f"option {shown(name)} is not known; {hint}")
        if name in names:
            raise OptionError(f"option {name!r} is given twice; give it once")
        names.add(name)
        field, read, allowed = row
        setting = read(value)
        if setting is None:
            raise OptionError(f"option {name}={shown(value)}: allowed are {allowed}")
        options = replace(options, **{field: setting})
    return options
