"""Whose a state directory is: what changes one must be run as its owner, or the autopilot could not read it."""

from __future__ import annotations

import os
import pwd
from pathlib import Path

from firmware_py.system.hold import StoreError


def check_directory(directory: Path) -> None:
    """StoreError when there is no such directory."""
    if not directory.is_dir():
        text = f"state directory {directory} is not there; name that of `rambler run --state`, or make it first"
        raise StoreError(text)


def check_owner(directory: Path) -> None:
    """StoreError when the directory, which is there, belongs to another user."""
    owner_uid = directory.stat().st_uid
    if os.geteuid() != owner_uid:
        raise StoreError(f"state directory {directory} belongs to {user_text(owner_uid)}; run this as that user")


def user_text(uid: int) -> str:
    """Return who a user is, for the operator."""
    try:
        return f"user {pwd.getpwuid(uid).pw_name}"
    except KeyError:
        return f"user {uid}"
