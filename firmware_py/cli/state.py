"""`rambler state`: export the state of an autopilot to one file, and replace that of a stopped autopilot by the file.

The file contains the signing key only with --with-key. Without it, the import keeps the key of the directory.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

from firmware_py import __version__
from firmware_py.cli.errors import print_error
from firmware_py.cli.state_owner import check_directory, check_owner, check_readable
from firmware_py.common.records import Stored
from firmware_py.core.resume import from_bytes as resume_from_bytes
from firmware_py.files.reading import read_regular
from firmware_py.files.writing import FILE_MODE, PRIVATE_MODE, exact_modes, write_atomically
from firmware_py.link.satellite.record import from_bytes as satellite_from_bytes
from firmware_py.link.signing import KeyState, Signing, find_key, timestamp_of
from firmware_py.system.directory_lock import DirectoryLock, StoreError
from firmware_py.system.endings import ENDINGS_FILE, Endings
from firmware_py.system.endings import from_bytes as endings_from_bytes
from firmware_py.system.endings import to_bytes as endings_to_bytes
from firmware_py.system.slots import examine
from firmware_py.system.state_directory import (
    PARAMETER_FILE,
    PLAN_FILES,
    RESUME_FILE,
    SATELLITE_FILE,
    SIGNING_FILE,
    STATE_NAMES,
    StateFiles,
    parse_stored_plan,
    read_key,
    read_parameters,
)
from firmware_py.system.state_export import MAX_EXPORT_BYTES, BrokenExportError, Export, begin_import, pack, unpack
from firmware_py.system.store import Store

# Decoders of the records; they return notes and raise ValueError.
DECODERS: Final[Mapping[str, Callable[[bytes], tuple[object, tuple[str, ...]]]]] = {
    ENDINGS_FILE: endings_from_bytes,
    RESUME_FILE: resume_from_bytes,
    SATELLITE_FILE: satellite_from_bytes,
}
DAMAGED_FILE = 1  # exit code: exported, but a file was damaged
_Warn = Callable[[str], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    commands = parser.add_subparsers(dest="state_command", metavar="WHAT", required=True)
    export_parser = commands.add_parser(
        "export", help="write parameters, plans, mode and goal to one file; the autopilot may be running"
    )
    import_parser = commands.add_parser("import", help="replace the state of a stopped autopilot by such a file")
    export_parser.add_argument("file", metavar="FILE", type=Path, help="output file; an existing one is replaced")
    import_parser.add_argument("file", metavar="FILE", type=Path, help="file written by `rambler state export`")
    export_parser.add_argument(
        "--with-key", action="store_true", help="include the signing key: anyone with the file can command the boat"
    )
    for command in (export_parser, import_parser):
        command.add_argument("--state", metavar="DIR", type=Path, required=True, help="state directory")
        command.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Run a subcommand; return 2 if it fails, 1 if a file was damaged."""
    command = {"export": _export, "import": _import}[arguments.state_command]
    try:
        check_directory(arguments.state)
        return command(arguments)
    except BrokenExportError as error:
        return print_error(f"state {arguments.state_command}", f"{arguments.file} {error}")
    except StoreError as error:
        return print_error(f"state {arguments.state_command}", error)


def _warn(text: str) -> None:
    print(text, file=sys.stderr)


# ------------------------------------------------------------------------------------ export


def _export(arguments: argparse.Namespace) -> int:
    """Export the state that the next start would read."""
    check_readable(arguments.state)
    files: dict[str, bytes | None] = {}
    damaged = False
    for name in STATE_NAMES:
        if name == SIGNING_FILE and not arguments.with_key:
            continue
        stored = StateFiles(arguments.state).examine(name)
        if stored.damage:
            damaged = True
            _warn(f"{arguments.state}: {stored.damage}{'' if stored.content is None else ': the other slot is used'}")
        if name == SIGNING_FILE:
            _check_key(arguments.state, stored)
        content = _without_current_run(stored.content) if name == ENDINGS_FILE else stored.content
        if content or name != SIGNING_FILE:
            files[name] = content
    if not any(files.values()):
        raise StoreError(f"state directory {arguments.state} contains no state; give that of `rambler run --state`")
    about = {
        "rambler": __version__, "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), "host": platform.node(),
        "directory": os.path.realpath(arguments.state),
    }  # fmt: skip
    try:
        mode = PRIVATE_MODE if SIGNING_FILE in files else FILE_MODE
        write_atomically(arguments.file, pack(Export(files, about)), mode)
    except OSError as error:
        raise StoreError(f"{arguments.file}: cannot be written: {error.strerror}") from None
    sizes = {name: "nothing" if content is None else f"{len(content)} bytes" for name, content in files.items()}
    _print_files(arguments, sizes)
    return DAMAGED_FILE if damaged else 0


def _check_key(directory: Path, stored: Stored) -> None:
    """Raise StoreError for a key that cannot be read."""
    key = find_key(stored)
    if key.state is KeyState.LOST:
        raise StoreError(f"state directory {directory}: {key.problem}; run this as its owner, or without --with-key")


def _without_current_run(content: bytes | None) -> bytes | None:
    """Remove the current run from the record of endings, since it does not end on the other computer."""
    if content is None:
        return None
    try:
        endings, notes = endings_from_bytes(content)
    except ValueError as error:
        _warn(f"{ENDINGS_FILE} left out: {error}")
        return None
    for note in notes:
        _warn(f"{ENDINGS_FILE}: {note}")
    return endings_to_bytes(Endings(endings.counts, endings.last))


# ------------------------------------------------------------------------------------ import


def _import(arguments: argparse.Namespace) -> int:
    """Replace the state by a file. One rename commits the import; an interruption after it does no harm."""
    directory = arguments.state
    check_owner(directory)
    try:
        export = unpack(read_regular(arguments.file, MAX_EXPORT_BYTES))
    except OSError as error:
        raise StoreError(f"{arguments.file}: cannot be read: {error.strerror}") from None
    for name in sorted(export.files.keys() - set(STATE_NAMES)):
        _warn(f"{arguments.file}: {name} ignored: written by another version")
    check_contents(export, _warn)
    previous = {name: examine(directory, name).content for name in STATE_NAMES}
    new_files = _begin_import(directory, export)
    try:
        with exact_modes():
            store = Store(directory)  # copies the import into the slots; after an interruption the next start does
            store.close()
    except StoreError as error:
        raise StoreError(f"{error}; the import is complete and takes effect at the next start") from None
    if store.start_problem:
        raise StoreError(store.start_problem)
    changes = {name: _describe_change(previous[name], new_files[name]) for name in new_files}
    _print_files(arguments, {SIGNING_FILE: "not in the file, unchanged", **changes})
    return 0


def _begin_import(directory: Path, export: Export) -> Mapping[str, bytes | None]:
    """Commit the import and return its files; raise StoreError if nothing was imported."""
    lock = DirectoryLock(directory)
    lock.acquire(strict=True)
    try:
        new_files = {name: export.files.get(name) for name in STATE_NAMES if name != SIGNING_FILE}
        if export.files.get(SIGNING_FILE):
            new_files[SIGNING_FILE] = _renew_key(export, read_key(directory))
        with exact_modes():
            begin_import(directory, Export(new_files, export.about))
    except OSError as error:
        raise StoreError(f"state directory {directory}: nothing was imported: {error.strerror}") from None
    finally:
        lock.release()
    return new_files


def check_contents(export: Export, warn: _Warn) -> None:
    """Raise BrokenExportError for files that the next start could not use; pass notes to `warn`."""
    for kind, name in PLAN_FILES.items():
        if (content := export.content(name)) is not None:
            with _reject_errors(name):
                for note in parse_stored_plan(kind, content.decode("ascii", "replace"))[1]:
                    warn(f"{name}: {note}")
    read_parameters(export.content(PARAMETER_FILE), warn)
    for name, read in DECODERS.items():
        if (content := export.content(name)) is not None:
            with _reject_errors(name):
                for note in read(content)[1]:
                    warn(f"{name}: {note}")
    key = export.content(SIGNING_FILE)
    if key is not None and find_key(Stored(key)).state is not KeyState.PRESENT:
        raise BrokenExportError(f"cannot be used: {SIGNING_FILE}: not a signing key; nothing was imported")


@contextlib.contextmanager
def _reject_errors(name: str) -> Iterator[None]:
    """Raise BrokenExportError if the decoder of this file raises an error."""
    try:
        yield
    except (ValueError, RecursionError) as error:
        raise BrokenExportError(f"cannot be used: {name}: {error}; nothing was imported") from None


def _renew_key(export: Export, stored: Stored) -> bytes:
    """Return the record of the key with present timestamps, so that frames signed earlier are not accepted again."""
    record = find_key(Stored(export.content(SIGNING_FILE))).record
    saved_contents: list[bytes] = []

    def save(content: bytes, *, both_slots: bool = False) -> None:
        del both_slots  # an import is written to both slots
        saved_contents.append(content)

    signing = Signing(time.time, save)
    signing.restore(stored)
    if record is None or not signing.set_key(record.key, max(record.timestamp, timestamp_of(time.time()))):
        raise BrokenExportError(f"cannot be used: {SIGNING_FILE}: its timestamp is out of range")
    return saved_contents[-1]


def _describe_change(previous: bytes | None, new: bytes | None) -> str:
    if new is None:
        return "nothing" if previous is None else f"nothing, instead of {len(previous)} bytes"
    size = f"{len(new)} bytes"
    if previous is None:
        return size
    return f"{size}, as before" if previous == new else f"{size}, instead of {len(previous)}"


def _print_files(arguments: argparse.Namespace, texts: Mapping[str, str]) -> None:
    if arguments.json:
        print(json.dumps({"file": str(arguments.file), "state": str(arguments.state), "names": texts}))
        return
    for name, text in texts.items():
        print(f"{name:<18} {text}")
