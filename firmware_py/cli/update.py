"""`rambler update`: install another version on trial, or return to the previous one."""

from __future__ import annotations

import argparse
import os
from contextlib import suppress
from pathlib import Path

from firmware_py.cli.errors import print_error
from firmware_py.install.bundle import UpdateError
from firmware_py.install.service_files import UNIT
from firmware_py.install.unit import read_installation
from firmware_py.install.update import SIGNERS, Permissions, await_trial, roll_back, update


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    choice = parser.add_mutually_exclusive_group(required=True)
    choice.add_argument("bundle", metavar="BUNDLE", type=Path, nargs="?", help="a bundle, made by `make bundle`")
    choice.add_argument("--back", action="store_true", help="return to the previous version")
    parser.add_argument(
        "--armed", action="store_true", help="update even while armed; the rudder is centred during the restart"
    )
    parser.add_argument("--older", action="store_true", help="allow a downgrade")
    parser.add_argument(
        "--signers",
        metavar="FILE",
        type=Path,
        help=f"allowed signers (ssh-keygen format); other bundles are refused (default: {SIGNERS}, if it exists)",
    )
    parser.add_argument(
        "--unit", metavar="FILE", type=Path, default=UNIT, help=f"unit file of the service (default: {UNIT})"
    )


def run(arguments: argparse.Namespace) -> int:
    """Return 0 if the trial passed, 1 if the version was rolled back or is still on trial, 2 for an error."""
    signers = arguments.signers or (SIGNERS if os.path.lexists(SIGNERS) else None)  # also a dangling link
    permissions = Permissions(armed=arguments.armed, older=arguments.older)
    try:
        installation = read_installation(arguments.unit)
        if installation.blocked_reason:
            return print_error("update", installation.blocked_reason)
        if arguments.back:
            roll_back(installation, permissions, _print_line)
        else:
            update(installation, arguments.bundle, signers, permissions, _print_line)
    except UpdateError as error:
        return print_error("update", error)
    except OSError as error:
        return print_error(
            "update", f"{error.filename or 'the disk'}: {error.strerror}; the installed version is unchanged"
        )
    return 0 if await_trial(installation, _print_line) else 1


def _print_line(text: str) -> None:
    """Print a line. A closed terminal or a full disk must not interrupt the update."""
    with suppress(OSError):
        print(text, flush=True)
