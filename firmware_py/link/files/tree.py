"""All files that ground stations see, by path: directories of the disk, and files in memory."""

from __future__ import annotations

import errno
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import msgspec

from firmware_py.common.interfaces import RequestHandler
from firmware_py.common.parameters import format_file
from firmware_py.link.files.area import MAX_DEPTH, MAX_NAME_LENGTH, Area, Entry, Parts
from firmware_py.link.files.payload import Error, Refusal
from firmware_py.link.parameters.files import Metadata, pack

Query = Mapping[str, str]  # what stands behind a question mark
# Returns the content of a file in memory when it is opened. Called on the worker's thread, since 2000 items take too
# long for the loop: it may read only objects that are replaced as a whole.
Generate = Callable[[Query], bytes]

PACKED_PARAMETERS: Parts = ("@PARAM", "param.pck")


class Origin(msgspec.Struct, frozen=True):
    """MAVLink address of the sender of an upload, and the time."""

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
        """Return the entries of a directory; may wait for the disk. Sizes of files in memory are the present ones."""
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
    path, _, query = text.decode("ascii").partition("?")
    parts = tuple(part for part in path.split("/") if part not in ("", "."))
    if any(part.startswith(".") for part in parts):
        # The parent directory, and hidden files, which are incomplete uploads.
        raise Refusal(Error.FILE_PROTECTED)
    if len(parts) > MAX_DEPTH + 1 or any(len(part) > MAX_NAME_LENGTH for part in parts):
        raise Refusal(Error.FAIL_ERRNO, errno.ENAMETOOLONG)
    pairs = (pair.partition("=") for pair in query.split("&") if pair)
    return parts, {name: value for name, _, value in pairs}


def _no_logs() -> Mapping[int, Path]:
    return {}


class FileRoot(msgspec.Struct, frozen=True):
    """The parts of the disk that ground stations may see.

    `catalogue` finds the logs by number, the newest highest; with `logging` that one is being written. `uploads`
    is the one directory that may be written to. `background`: the disk is waited for on a thread of its own.
    """

    catalogue: Callable[[], Mapping[int, Path]] = _no_logs
    logs: Path | None = None
    uploads: Path | None = None
    logging: bool = False
    background: bool = False


def tree_of(
    storage: FileRoot,
    metadata: Metadata,
    request_handler: RequestHandler,
    more: Mapping[Parts, Generate],
    sinks: Mapping[Parts, Sink],
) -> Tree:
    """Return all files for file transfer; `more` is generated when it is read, `sinks` apply an upload."""
    areas = {}
    if storage.logs is not None:
        areas["logs"] = Area(storage.logs, writable=False)
    if storage.uploads is not None:
        areas["uploads"] = Area(storage.uploads, writable=True)
    made: dict[Parts, Generate] = {path: partial(_same, content) for path, content in metadata.files.items()}
    made[PACKED_PARAMETERS] = lambda query: pack(request_handler.parameters(), query, metadata.autopilot)
    made["parameters.param",] = lambda _: format_file(dict(request_handler.parameters().items())).encode()
    return Tree(areas, {**made, **more}, sinks)


def _same(content: bytes, _: object) -> bytes:
    return content
