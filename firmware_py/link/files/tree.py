"""All files that ground stations see, by path: areas of the disk, and files that exist in memory only."""

from __future__ import annotations

import errno
from collections.abc import Callable, Mapping

import msgspec

from firmware_py.link.files.area import DEEPEST, LONGEST_NAME, Area, Entry, Parts
from firmware_py.link.files.payload import Error, Refusal

Query = Mapping[str, str]  # what stands behind a question mark
# The content of a file in memory, at the moment that it is opened. Called on the worker's thread, because 2000 items
# take longer than the loop has to spare: it may look at nothing but what is replaced as a whole.
Generate = Callable[[Query], bytes]


class Origin(msgspec.Struct, frozen=True):
    """Who has uploaded something: its MAVLink address, and when."""

    system: int
    component: int
    now_s: float


# Puts an uploaded file in force, and calls back once with the reason of a refusal, or "" when it is done.
Sink = Callable[[bytes, Origin, Callable[[str], None]], None]


class Tree(msgspec.Struct, frozen=True):
    """The root: areas by the name of their directory, files in memory and sinks by their whole path."""

    areas: Mapping[str, Area] = msgspec.field(default_factory=dict)
    generated: Mapping[Parts, Generate] = msgspec.field(default_factory=dict)
    sinks: Mapping[Parts, Sink] = msgspec.field(default_factory=dict)

    def area(self, parts: Parts, *, write: bool = False) -> tuple[Area, Parts]:
        """Return the area that a path lies in and the path within it; Refusal where there is none."""
        area = self.areas.get(parts[0]) if parts else None
        if area is None:
            protected = write and (
                not parts or parts in self.generated or len(parts) == 1 or parts[0] in self.directories()
            )
            raise Refusal(Error.FILE_PROTECTED if protected else Error.FILE_NOT_FOUND)
        if write and not area.writable:
            raise Refusal(Error.FILE_PROTECTED)
        return area, parts[1:]

    def directories(self) -> set[str]:
        """Return the names of the directories in the root."""
        return {*self.areas, *(parts[0] for parts in (*self.generated, *self.sinks) if len(parts) > 1)}

    def listing(self, parts: Parts) -> tuple[Entry, ...]:
        """Return what a directory holds; may wait for the disk. Sizes of files in memory are those of now."""
        if parts and parts[0] in self.areas:
            return self.areas[parts[0]].listing(parts[1:])
        if not parts:
            return tuple(sorted([*self._generated_in(()), *(Entry(name, True, 0, 0) for name in self.directories())]))
        within = self._generated_in(parts)
        if not within:
            raise Refusal(Error.FILE_NOT_FOUND)
        return tuple(sorted(within))

    def _generated_in(self, parts: Parts) -> list[Entry]:
        files = ((path, make) for path, make in self.generated.items() if path[:-1] == parts)
        return [Entry(path[-1], False, len(make({})), 0) for path, make in files]


def parse_path(raw: bytes) -> tuple[Parts, Query]:
    """Read a path as it came, up to its first NUL; Refusal for one that no file can have."""
    text = raw.split(b"\0", 1)[0]
    if not all(0x20 <= byte < 0x7F for byte in text):
        raise Refusal(Error.FAIL_ERRNO, errno.EINVAL)
    path, _, asked = text.decode("ascii").partition("?")
    parts = tuple(part for part in path.split("/") if part not in ("", "."))
    if any(part.startswith(".") for part in parts):
        # The directory above, and what is hidden: uploads that are not whole.
        raise Refusal(Error.FILE_PROTECTED)
    if len(parts) > DEEPEST + 1 or any(len(part) > LONGEST_NAME for part in parts):
        raise Refusal(Error.FAIL_ERRNO, errno.ENAMETOOLONG)
    pairs = (pair.partition("=") for pair in asked.split("&") if pair)
    return parts, {name: value for name, _, value in pairs}
