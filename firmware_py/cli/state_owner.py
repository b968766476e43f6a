"""Location and owner of the state directory of the service, or of a user."""

from __future__ import annotations

import os
import pwd
import shlex
from pathlib import Path

from firmware_py.cli.run import default_state_directory
from firmware_py.install.bundle import UpdateError
from firmware_py.install.service_files import UNIT
from firmware_py.install.unit import read_installation
from firmware_py.system.directory_lock import StoreError
from firmware_py.vehicle import Vehicle


def state_directory_of(file: Path, vehicle: Vehicle) -> Path:
    """Return the state directory of the service with this vehicle file, else the default of `rambler run`."""
    try:
        service = read_installation(UNIT)
    except UpdateError:  # not installed
        return default_state_directory(vehicle.name)
    same_file = os.path.realpath(service.vehicle) == os.path.realpath(file)
    return service.state if same_file else default_state_directory(vehicle.name)


def check_directory(directory: Path) -> None:
    """Raise StoreError if the directory does not exist."""
    if directory.is_dir():
        return
    problem, remedy = "does not exist", f", or create it: mkdir -p {shlex.quote(str(directory))}"
    if directory.exists():
        problem, remedy = "is a file", ""
    raise StoreError(f"state directory {directory} {problem}; give that of `rambler run --state`{remedy}")


def check_readable(directory: Path) -> None:
    """Raise StoreError if this user cannot read the directory."""
    if not os.access(directory, os.R_OK | os.X_OK):
        owner = describe_user(directory.stat().st_uid)
        raise StoreError(f"state directory {directory} permission denied; run this as {owner}, or as root (sudo)")


def check_owner(directory: Path) -> None:
    """Raise StoreError if the directory belongs to another user."""
    owner_uid = directory.stat().st_uid
    if os.geteuid() != owner_uid:
        raise StoreError(f"state directory {directory} belongs to {describe_user(owner_uid)}; run this as that user")


def find_foreign_files(directory: Path) -> str:
    """Return an error text if files in the directory have another owner than the directory, else an empty text."""
    owner_uid = directory.stat().st_uid
    paths = [*directory.glob("*"), *directory.glob("logs/**/*")]
    foreign_paths = [path for path in paths if path.lstat().st_uid != owner_uid and path.name != "lost+found"]
    if not foreign_paths:
        return ""
    file_owner = describe_user(foreign_paths[0].lstat().st_uid)
    others = f" and {len(foreign_paths) - 1} more" if foreign_paths[1:] else ""
    owner = describe_user(owner_uid)
    remedy = f"chown -R --reference={directory} {directory}"
    return f"{foreign_paths[0]}{others} owned by {file_owner}, the autopilot runs as {owner}; {remedy}"


def describe_user(uid: int) -> str:
    """Return the name of a user for a message."""
    try:
        return f"user {pwd.getpwuid(uid).pw_name}"
    except KeyError:
        return f"user {uid}"
