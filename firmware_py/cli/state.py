"""`rambler state`: the state of an autopilot as one file, out of its directory and into that of a stopped one.

The key is in the file only when it is asked for; without it the directory that takes the file keeps its own.
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
from firmware_py.cli.refusal import refused
from firmware_py.cli.state_owner import check_directory, check_owner, check_readable
from firmware_py.common.records import Stored
from firmware_py.core.resume import from_bytes as resume_from_bytes
from firmware_py.files.making import FILE_MODE, PRIVATE_MODE, exact_modes, write_whole
from firmware_py.files.reading import read_regular
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
    checked_plan,
    read_parameters,
    stored_key,
)
from firmware_py.system.state_export import MAX_EXPORT_BYTES, BrokenExportError, Export, begin_import, pack, unpack
from firmware_py.system.store import Store

# The function that decodes each record; it returns notes, too, and raises ValueError.
_RECORDS: Final[Mapping[str, Callable[[bytes], tuple[object, tuple[str, ...]]]]] = {
    ENDINGS_FILE: endings_from_bytes,
    RESUME_FILE: resume_from_bytes,
    SATELLITE_FILE: satellite_from_bytes,
}
FINDING = 1  # the exit code of a state that was exported, and not all of it whole
_Say = Callable[[str], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    commands = parser.add_subparsers(dest="state_command", metavar="WHAT", required=True)
    out = commands.add_parser("export", help="write parameters, plans and what she was doing to one file, at any time")
    into = commands.add_parser("import", help="put such a file in place of the state of a stopped autopilot")
    out.add_argument("file", metavar="FILE", type=Path, help="what to write; one that is there is replaced")
    into.add_argument("file", metavar="FILE", type=Path, help="what `rambler state export` has written")
    out.add_argument("--with-key", action="store_true", help="the signing key, too: whoever has the file may command")
    for command in (out, into):
        command.add_argument("--state", metavar="DIR", type=Path, required=True, help="the state directory")
        command.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Do what is asked; lines on standard error and 2 when it cannot be, 1 when not all of it was whole."""
    command = {"export": _export, "import": _import}[arguments.state_command]
    try:
        check_directory(arguments.state)
        return command(arguments)
    except BrokenExportError as error:
        return refused(f"state {arguments.state_command}", f"{arguments.file} {error}")
    except StoreError as error:
        return refused(f"state {arguments.state_command}", error)


def _tell(text: str) -> None:
    print(text, file=sys.stderr)


# ------------------------------------------------------------------------------------ out


def _export(arguments: argparse.Namespace) -> int:
    """Read what the next start would, beside an autopilot that may be running."""
    check_readable(arguments.state)
    files: dict[str, bytes | None] = {}
    damaged = False
    for name in STATE_NAMES:
        if name == SIGNING_FILE and not arguments.with_key:
            continue
        stored = StateFiles(arguments.state).examine(name)
        if stored.damage:
            damaged = True
            _tell(f"{arguments.state}: {stored.damage}{'' if stored.content is None else ': the other slot is taken'}")
        if name == SIGNING_FILE:
            _check_key(arguments.state, stored)
        content = _settled(stored.content) if name == ENDINGS_FILE else stored.content
        if content or name != SIGNING_FILE:
            files[name] = content
    if not any(files.values()):
        raise StoreError(f"state directory {arguments.state} holds no state; name that of `rambler run --state`")
    about = {
        "rambler": __version__, "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), "host": platform.node(),
        "directory": os.path.realpath(arguments.state),
    }  # fmt: skip
    try:
        mode = PRIVATE_MODE if SIGNING_FILE in files else FILE_MODE
        write_whole(arguments.file, pack(Export(files, about)), mode)
    except OSError as error:
        raise StoreError(f"{arguments.file}: cannot be written: {error.strerror}") from None
    told = {name: "nothing" if content is None else f"{len(content)} bytes" for name, content in files.items()}
    _report(arguments, told)
    return FINDING if damaged else 0


def _check_key(directory: Path, stored: Stored) -> None:
    """StoreError for a key that is there and cannot be had."""
    finding = find_key(stored)
    if finding.state is KeyState.LOST:
        raise StoreError(
            f"state directory {directory}: {finding.problem}; run this as its owner, or without --with-key"
        )


def _settled(content: bytes | None) -> bytes | None:
    """Return how runs have ended, without the one under way: it does not end where the file is taken to."""
    if content is None:
        return None
    try:
        endings, notes = endings_from_bytes(content)
    except ValueError as error:
        _tell(f"{ENDINGS_FILE} left out: {error}")
        return None
    for note in notes:
        _tell(f"{ENDINGS_FILE}: {note}")
    return endings_to_bytes(Endings(endings.counts, endings.last))


# ------------------------------------------------------------------------------------ in


def _import(arguments: argparse.Namespace) -> int:
    """Put a file in place of the state: all of it from one rename on, however often what follows is cut off."""
    directory = arguments.state
    check_owner(directory)
    try:
        export = unpack(read_regular(arguments.file, MAX_EXPORT_BYTES))
    except OSError as error:
        raise StoreError(f"{arguments.file}: cannot be read: {error.strerror}") from None
    for name in sorted(export.files.keys() - set(STATE_NAMES)):
        _tell(f"{arguments.file}: {name} left out: it is of another version")
    _check_contents(export, _tell)
    before = {name: examine(directory, name).content for name in STATE_NAMES}
    wanted = _begin_import(directory, export)
    try:
        with exact_modes():
            store = Store(directory)  # whoever holds it next puts it into the slots: if we are killed, the autopilot
            store.close()
    except StoreError as error:
        raise StoreError(f"{error}; what was imported counts all the same, from the next start on") from None
    if store.start_problem:
        raise StoreError(store.start_problem)
    told = {name: _change(before[name], wanted[name]) for name in wanted}
    _report(arguments, {SIGNING_FILE: "not in the file, stays as it is", **told})
    return 0


def _begin_import(directory: Path, export: Export) -> Mapping[str, bytes | None]:
    """Let the directory count for what is imported; return what that is. StoreError: nothing was imported."""
    hold = DirectoryLock(directory)
    hold.acquire(strict=True)
    try:
        wanted = {name: export.files.get(name) for name in STATE_NAMES if name != SIGNING_FILE}
        if export.files.get(SIGNING_FILE):
            wanted[SIGNING_FILE] = _key_in_force(export, stored_key(directory))
        with exact_modes():
            begin_import(directory, Export(wanted, export.about))
    except OSError as error:
        raise StoreError(f"state directory {directory}: nothing was imported: {error.strerror}") from None
    finally:
        hold.release()
    return wanted


def _check_contents(export: Export, say: _Say) -> None:
    """Raise BrokenExportError for what the next start could not use; what it would only tell is said."""
    for kind, name in PLAN_FILES.items():
        if (content := export.content(name)) is not None:
            with _usable(name):
                for note in checked_plan(kind, content.decode("ascii", "replace"))[1]:
                    say(f"{name}: {note}")
    read_parameters(export.content(PARAMETER_FILE), say)
    for name, read in _RECORDS.items():
        if (content := export.content(name)) is not None:
            with _usable(name):
                for note in read(content)[1]:
                    say(f"{name}: {note}")
    key = export.content(SIGNING_FILE)
    if key is not None and find_key(Stored(key)).state is not KeyState.PRESENT:
        raise BrokenExportError(f"cannot be used: {SIGNING_FILE}: it is no signing key; nothing was imported")


@contextlib.contextmanager
def _usable(name: str) -> Iterator[None]:
    try:
        yield
    except (ValueError, RecursionError) as error:
        raise BrokenExportError(f"cannot be used: {name}: {error}; nothing was imported") from None


def _key_in_force(export: Export, present: Stored) -> bytes:
    """Return the key with timestamps of now, as when it is set anew: what was signed before is not heard again."""
    record = find_key(Stored(export.content(SIGNING_FILE))).record
    kept: list[bytes] = []

    def keep(content: bytes, *, both_slots: bool = False) -> None:
        del both_slots  # an import goes into both slots
        kept.append(content)

    signing = Signing(time.time, keep)
    signing.restore(present)
    if record is None or not signing.set_key(record.key, max(record.timestamp, timestamp_of(time.time()))):
        raise BrokenExportError(f"cannot be used: {SIGNING_FILE}: its time is beyond all calendars")
    return kept[-1]


def _change(before: bytes | None, after: bytes | None) -> str:
    if after is None:
        return "nothing" if before is None else f"nothing, instead of {len(before)} bytes"
    size = f"{len(after)} bytes"
    if before is None:
        return size
    return f"{size}, as before" if before == after else f"{size}, instead of {len(before)}"


def _report(arguments: argparse.Namespace, told: Mapping[str, str]) -> None:
    if arguments.json:
        print(json.dumps({"file": str(arguments.file), "state": str(arguments.state), "names": told}))
        return
    for name, text in told.items():
        print(f"{name:<18} {text}")
