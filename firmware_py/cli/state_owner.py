"""Whose a state directory is: that of the service, or of a user; what changes one must be run as its owner."""

from __future__ import annotations

import os
import pwd
import shlex
from pathlib import Path

from firmware_py.cli.run import default_state_directory
from firmware_py.install.bundle import UpdateError
from firmware_py.install.service_files import UNIT
from firmware_py.install.unit import installation_of
from firmware_py.system.directory_lock import StoreError
from firmware_py.vehicle import Vehicle


def state_directory_of(file: Path, vehicle: Vehicle) -> Path:
    """Return where the state of a vehicle file is: with the service that runs it, else where `rambler run` keeps it."""
    try:
        service = installation_of(UNIT)
    except UpdateError:  # there is none
        return default_state_directory(vehicle.name)
    ours = os.path.realpath(service.vehicle) == os.path.realpath(file)
    return service.state if ours else default_state_directory(vehicle.name)


def check_directory(directory: Path) -> None:
    """StoreError when there is no such directory."""
    if directory.is_dir():
        return
    what, remedy = "is not there", f", or make it: mkdir -p {shlex.quote(str(directory))}"
    if directory.exists():
        what, remedy = "is a file", ""
    raise StoreError(f"state directory {directory} {what}; name that of `rambler run --state`{remedy}")


def check_readable(directory: Path) -> None:
    """StoreError when the directory, which is there, is closed to this user: what is in it has not been lost."""
    if not os.access(directory, os.R_OK | os.X_OK):
        owner = user_text(directory.stat().st_uid)
        raise StoreError(f"state directory {directory} may not be read; run this as {owner}, or as root (sudo)")


def check_owner(directory: Path) -> None:
    """StoreError when the directory, which is there, belongs to another user."""
    owner_uid = directory.stat().st_uid
    if os.geteuid() != owner_uid:
        raise StoreError(f"state directory {directory} belongs to {user_text(owner_uid)}; run this as that user")


def foreign_file(directory: Path) -> str:
    """Return what is wrong with whom the files of a state directory belong to, empty when nothing is."""
    owner_uid = directory.stat().st_uid
    places = [*directory.glob("*"), *directory.glob("logs/**/*")]
    foreign = [place for place in places if place.lstat().st_uid != owner_uid and place.name != "lost+found"]
    if not foreign:
        return ""
    whose, more = user_text(foreign[0].lstat().st_uid), f" and {len(foreign) - 1} more" if foreign[1:] else ""
    owner = user_text(owner_uid)
    return f"{foreign[0]}{more} of {whose}: the autopilot runs as {owner}; chown -R --reference={directory} {directory}"


def user_text(uid: int) -> str:
    """Return who a user is, for the operator."""
    try:
        return f"user {pwd.getpwuid(uid).pw_name}"
    except KeyError:
        return f"user {uid}"
