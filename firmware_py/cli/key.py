"""`rambler key`: show the state of the signing key, set it, or remove it, without a link.

Neither the key nor a digest of it is printed: a passphrase could be guessed from a digest. The key is not an argument,
since other users can read the arguments of a process.
"""

from __future__ import annotations

import argparse
import getpass
import json
import os
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path

from firmware_py.cli.state_owner import check_directory, check_owner, describe_user
from firmware_py.link.signing import KEY_BYTES, KeyState, Signing, find_key, key_of_passphrase, timestamp_of
from firmware_py.system.directory_lock import StoreError
from firmware_py.system.state_directory import SIGNING_FILE, KeyVault, find_exposed_key_files, read_key
from firmware_py.system.store import Store

MAX_PASSPHRASE_BYTES = 1024
_UNREADABLE = "unreadable"  # state for a user who is not the owner
_HEX = re.compile(rf"[0-9a-fA-F]{{{2 * KEY_BYTES}}}")


class KeyInputError(ValueError):
    """The input is not a key; the text names the remedy."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    commands = parser.add_subparsers(dest="key_command", metavar="WHAT", required=True)
    show_parser = commands.add_parser(
        "show-state", help="print the state of the key: present, absent, lost or unreadable"
    )
    set_parser = commands.add_parser("set", help="set the key from a passphrase, typed or read from standard input")
    remove_parser = commands.add_parser("remove", help="overwrite and remove the key")
    set_parser.add_argument("--key-file", metavar="FILE", type=Path, help="read the passphrase from this file instead")
    set_parser.add_argument("--hex", action="store_true", help="the input is the key itself: 64 hexadecimal digits")
    for command in (show_parser, set_parser, remove_parser):
        command.add_argument("--state", metavar="DIR", type=Path, required=True, help="state directory")
        command.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Run a subcommand; return 2 with one line on standard error if it fails."""
    command = {"show-state": _print_state, "set": _set, "remove": _remove}[arguments.key_command]
    try:
        check_directory(arguments.state)
        command(arguments)
    except (KeyInputError, StoreError) as error:
        print(f"rambler key {arguments.key_command}: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        if error.filename is None:  # an error of standard output, not of the directory
            raise
        print(f"rambler key {arguments.key_command}: {arguments.state}: {error.strerror}", file=sys.stderr)
        return 2
    return 0


def _print_state(arguments: argparse.Namespace) -> None:
    """Print the state of the key as the next start would find it."""
    stored = read_key(arguments.state)
    key = find_key(stored)
    state, problem = key.state.value, key.problem or stored.damage
    if key.state is KeyState.LOST and os.geteuid() not in (0, owner := arguments.state.stat().st_uid):
        state, problem = _UNREADABLE, f"{problem}; run this as {describe_user(owner)}"
    exposed = find_exposed_key_files(arguments.state)
    if arguments.json:
        print(json.dumps({"state": state, "problem": problem, "readable_by_others": list(exposed)}))
        return
    print(f"{arguments.state}: {state}{problem and f': {problem}'}")
    for name in exposed:
        print(f"{arguments.state}: {name} is readable by other users; chmod 600", file=sys.stderr)


def _set(arguments: argparse.Namespace) -> None:
    line = _read_line(arguments.key_file, is_hex=arguments.hex)
    if arguments.hex and not _HEX.fullmatch(line):
        raise KeyInputError(f"a key has {2 * KEY_BYTES} hexadecimal digits; for a passphrase, omit --hex")
    key = bytes.fromhex(line) if arguments.hex else key_of_passphrase(line)
    if not any(key):
        raise KeyInputError("a key must not be all zeros; `rambler key remove` removes it")
    _change(arguments, KeyState.PRESENT, lambda signing: signing.set_key(key, timestamp_of(time.time())))


def _remove(arguments: argparse.Namespace) -> None:
    _change(arguments, KeyState.ABSENT, lambda signing: signing.remove_key())


def _change(arguments: argparse.Namespace, state: KeyState, change: Callable[[Signing], object]) -> None:
    """Change the key of a stopped autopilot and print its state."""
    check_owner(arguments.state)
    try:
        store = Store(arguments.state, private=(SIGNING_FILE,))
    except StoreError as error:
        raise StoreError(f"{error}, or set the key over a trusted link") from None
    vault = KeyVault(store)
    signing = Signing(time.time, vault.save)
    signing.restore(vault.load())
    change(signing)
    store.close()
    if store.start_problem:
        print(store.start_problem, file=sys.stderr)
    if store.failure:
        raise StoreError(f"state directory {arguments.state}: {store.failure}; free space and try again")
    if arguments.json:
        print(json.dumps({"state": state.value}))
    else:
        print(f"{arguments.state}: {state.value}")


def _read_line(file: Path | None, *, is_hex: bool) -> str:
    """Read one line from a file, a terminal without echo or standard input; raise KeyInputError for other input."""
    if file is not None:
        try:
            with file.open("rb") as opened_file:
                data = opened_file.read(MAX_PASSPHRASE_BYTES + 1)
        except OSError as error:
            raise KeyInputError(f"{file}: {error.strerror}; give a readable file") from None
    elif sys.stdin.isatty():
        prompt = "Key" if is_hex else "Passphrase"
        entry = getpass.getpass(f"{prompt}: ")
        if entry != getpass.getpass(f"{prompt} again: "):
            raise KeyInputError("the two entries differ; try again")
        data = entry.encode()
    else:
        data = sys.stdin.buffer.read(MAX_PASSPHRASE_BYTES + 1)
    try:
        line = data.removesuffix(b"\n").removesuffix(b"\r").decode()
    except UnicodeDecodeError:
        line = ""
    if not line or not line.isprintable() or len(data) > MAX_PASSPHRASE_BYTES:
        raise KeyInputError(f"the input must be one line of text with 1 to {MAX_PASSPHRASE_BYTES} bytes")
    return line
