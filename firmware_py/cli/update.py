"""`rambler update`: another version of the autopilot put in force, on trial, and back."""

from __future__ import annotations

import argparse
import os
from contextlib import suppress
from pathlib import Path

from firmware_py.cli.refusal import refused
from firmware_py.install.bundle import UpdateError
from firmware_py.install.service_files import UNIT
from firmware_py.install.unit import installation_of
from firmware_py.install.update import SIGNERS, Permissions, await_trial, go_back, update


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("bundle", metavar="BUNDLE", type=Path, nargs="?", help="the file that make bundle has made")
    what.add_argument("--back", action="store_true", help="the version that was in force before")
    parser.add_argument(
        "--armed", action="store_true", help="even while she is armed; the rudder goes amidships for the restart"
    )
    parser.add_argument("--older", action="store_true", help="even to an older version")
    parser.add_argument(
        "--signers",
        metavar="FILE",
        type=Path,
        help=f"take only what one of these has signed, as ssh-keygen reads them (default {SIGNERS}, if it is there)",
    )
    parser.add_argument(
        "--unit", metavar="FILE", type=Path, default=UNIT, help=f"the unit of the service (default {UNIT})"
    )


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 when the new version has passed its trial, 1 when it was taken back or is on trial, 2 when refused."""
    signers = arguments.signers or (SIGNERS if os.path.lexists(SIGNERS) else None)  # a link that leads nowhere, too
    may = Permissions(armed=arguments.armed, older=arguments.older)
    try:
        installation = installation_of(arguments.unit)
        if installation.blocked_reason:
            return refused("update", installation.blocked_reason)
        if arguments.back:
            go_back(installation, may, _say)
        else:
            update(installation, arguments.bundle, signers, may, _say)
    except UpdateError as error:
        return refused("update", error)
    except OSError as error:
        return refused("update", f"{error.filename or 'the disk'}: {error.strerror}; what is in force stays")
    return 0 if await_trial(installation, _say) else 1


def _say(text: str) -> None:
    """Print a line; a terminal that has gone or a full disk behind it is no reason to stop half-way."""
    with suppress(OSError):
        print(text, flush=True)
