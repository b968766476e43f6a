"""What the link shows of the disk, and the files in memory beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import msgspec

from firmware_py.common.interfaces import RequestHandler
from firmware_py.common.parameters import format_file
from firmware_py.link.files.area import Area, Parts
from firmware_py.link.files.tree import Generate, Sink, Tree
from firmware_py.link.parameters.metadata import Metadata
from firmware_py.link.parameters.pack import pack

PACKED_PARAMETERS: Parts = ("@PARAM", "param.pck")


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
    """Return all that file transfer shows; `more` is made when it is read, `sinks` put an upload in force."""
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
