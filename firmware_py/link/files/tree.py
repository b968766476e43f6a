"""File tree for ground stations: directories of the disk, and files that are generated in memory."""

from __future__ import annotations

import errno
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import msgspec

from firmware_py.common.interfaces import RequestHandler
from firmware_py.common.parameters import format_file
from firmware_py.link.files.area import MAX_DEPTH, MAX_NAME_LENGTH, Area, Entry, PathParts
from firmware_py.link.files.payload import Error, Refusal
from firmware_py.link.parameters.files import Metadata, pack

Query = Mapping[str, str]  # options after the question mark of a path
# Generates the content of a file when it is opened. It runs on the worker's thread, since 2000 mission items take too
# long for the loop. Therefore it may read only immutable objects.
Generate = Callable[[Query], bytes]

PACKED_PARAMETERS: PathParts = ("@PARAM", "param.pck")


class Origin(msgspec.Struct, frozen=True):
    """MAVLink address of the sender of an upload, and the time."""

    system: int
    component: int
    now_s: float


# Applies an uploaded file, and calls the callback once, with the reason of a refusal, or "" after success.
Sink = Callable[[bytes, Origin, Callable[[str], None]], None]


class Tree(msgspec.Struct, frozen=True):
    """Root of the tree: areas by the name of their directory; generated files and sinks by their path."""

    areas: Mapping[str, Area] = msgspec.field(default_factory=dict)
    generated: Mapping[PathParts, Generate] = msgspec.field(default_factory=dict)
    sinks: Mapping[PathParts, Sink] = msgspec.field(default_factory=dict)

    def find_area(self, parts: PathParts, *, write: bool = False) -> tuple[Area, PathParts]:
        """Return the area that contains a path, and the path relative to it; raise Refusal without an area."""
        area = self.areas.get(parts[0]) if parts else None
        if area is None:
            is_protected = write and (len(parts) <= 1 or parts[0] in self.directory_names())
            raise Refusal(Error.FILE_PROTECTED if is_protected else Error.FILE_NOT_FOUND)
        if write and not area.writable:
            raise Refusal(Error.FILE_PROTECTED)
        return area, parts[1:]

    def directory_names(self) -> set[str]:
        """Return the names of the directories in the root."""
        return {*self.areas, *(parts[0] for parts in (*self.generated, *self.sinks) if len(parts) > 1)}

    def list_directory(self, parts: PathParts) -> tuple[Entry, ...]:
        """Return the entries of a directory; may block on the disk. Generated files have their present size."""
        if parts and parts[0] in self.areas:
            return self.areas[parts[0]].list_directory(parts[1:])
        if not parts:
            return tuple(
                sorted([*self._generated_in(()), *(Entry(name, True, 0, 0) for name in self.directory_names())])
            )
        entries = self._generated_in(parts)
        if not entries:
            raise Refusal(Error.FILE_NOT_FOUND)
        return tuple(sorted(entries))

    def _generated_in(self, parts: PathParts) -> list[Entry]:
        files = ((path, generate) for path, generate in self.generated.items() if path[:-1] == parts)
        return [Entry(path[-1], False, len(generate({})), 0) for path, generate in files]


def parse_path(raw: bytes) -> tuple[PathParts, Query]:
    """Decode a path up to its first NUL; raise Refusal for characters, names or depths that are not allowed."""
    text = raw.partition(b"\0")[0]
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


class FileRoot(msgspec.Struct, frozen=True):
    """The directories of the disk that ground stations may read.

    `catalogue` returns the paths of the logs by number; the newest has the highest number, and `logging` says that it
    is being written. Only the directory `uploads` is writable. `background`: disk operations run on a separate thread.
    """

    catalogue: Callable[[], Mapping[int, Path]] = dict
    logs: Path | None = None
    uploads: Path | None = None
    logging: bool = False
    background: bool = False


def build_tree(
    storage: FileRoot,
    metadata: Metadata,
    request_handler: RequestHandler,
    other_files: Mapping[PathParts, Generate],
    sinks: Mapping[PathParts, Sink],
) -> Tree:
    """Return the file tree: logs and uploads of the disk, parameters, metadata, `other_files` and `sinks`."""
    areas = {}
    if storage.logs is not None:
        areas["logs"] = Area(storage.logs, writable=False)
    if storage.uploads is not None:
        areas["uploads"] = Area(storage.uploads, writable=True)
    generated: dict[PathParts, Generate] = {
        path: partial(_constant_content, content) for path, content in metadata.files.items()
    }
    generated[PACKED_PARAMETERS] = lambda query: pack(request_handler.parameters(), query, metadata.autopilot)
    generated["parameters.param",] = lambda _: format_file(dict(request_handler.parameters().items())).encode()
    return Tree(areas, {**generated, **other_files}, sinks)


def _constant_content(content: bytes, _: object) -> bytes:
    return content
