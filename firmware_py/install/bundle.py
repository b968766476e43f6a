"""Bundles: one file with all packages of a version of the autopilot, for installation without a network.

A bundle is a tar archive. Its first member lists the others with length and SHA-256; the second may be a signature of
that list by ssh-keygen(1). `make bundle` writes it (.ci/bundle.py). A member is used only after its hash was checked.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.files.reading import open_regular, read_json

LIST, SIGNATURE, LOCK = "bundle.json", "bundle.json.sig", "requirements.txt"
FORMAT: Final = 1
SIGNER, NAMESPACE = "rambler", "rambler-update"  # principal and namespace of ssh-keygen
_MAX_LIST_BYTES, _MAX_SIGNATURE_BYTES, _MAX_FILE_BYTES = 1 << 20, 1 << 16, 1 << 30
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,200}")
_HASH = re.compile(r"[0-9a-f]{64}")
_VERSION = re.compile(r"(\d{1,6})\.(\d{1,6})\.(\d{1,6})(?:\.?(dev|a|b|rc)(\d{1,6}))?")
_STAGES = ("dev", "a", "b", "rc", "")
PYTHON: Final = sys.version_info[:2]
_CHUNK_BYTES = 1 << 20
_TIMEOUT_S = 30.0


class UpdateError(RuntimeError):
    """The update is refused; the text names the remedy. The installed version is unchanged."""


class Bundle(msgspec.Struct, frozen=True):
    """The list of a bundle: version, commit, time of the commit, length and hash of each file.

    `digest` is the SHA-256 of the list, which identifies the bundle.
    """

    version: str
    commit: str
    commit_utc_s: int
    files: Mapping[str, tuple[int, str]]
    digest: str

    @property
    def title(self) -> str:
        """Return version and commit as a text for messages."""
        return format_title(self.version, self.commit)

    def wheel_of(self, prefix: str) -> str:
        """Return the name of the wheel of a package; raise UpdateError without one."""
        for name in self.files:
            if name.startswith(f"{prefix}-") and name.endswith(".whl"):
                return name
        raise UpdateError(f"no wheel of {prefix} in the bundle; build it again (make bundle)")


def format_title(version: str, commit: str) -> str:
    """Format a version with its commit for messages."""
    return f"{version} (git {commit})" if commit else version


def check_computer(bundle: Bundle, machine: str = platform.machine(), python: tuple[int, int] = PYTHON) -> None:
    """Raise UpdateError if a package of a bundle has no wheel for this machine and Python.

    A 32-bit Python is not checked, because a 64-bit kernel reports another machine; then pip checks the wheels.
    """
    if sys.maxsize < 1 << 32:
        return
    has_wheel: dict[str, bool] = {}
    for name in bundle.files:
        if name.endswith(".whl") and name.count("-") >= 4:  # PACKAGE-VERSION[-BUILD]-PYTHON-ABI-PLATFORM.whl
            package, (python_tags, abi, platforms) = name.partition("-")[0], name[:-4].split("-")[-3:]
            is_pure = abi == "none" and "any" in platforms.split(".")
            fits_python = f"cp{python[0]}{python[1]}" in python_tags.split(".") or abi in ("abi3", "none")
            fits = is_pure or (fits_python and any(tag.endswith(f"_{machine}") for tag in platforms.split(".")))
            has_wheel[package] = has_wheel.get(package, False) or fits
    if missing := sorted(package for package, fits in has_wheel.items() if not fits):
        computer = f"{machine}:{python[0]}.{python[1]}"
        raise UpdateError(f"the bundle is for other computers ({missing[0]}); make bundle FOR={computer}")


def read_list(content: bytes) -> Bundle:
    """Parse the list of a bundle; raise UpdateError if it is invalid."""
    try:
        data: Any = read_json(content)
        if data["format"] != FORMAT:
            raise UpdateError(f"the bundle has format {str(data['format'])[:20]}, this program reads format {FORMAT}")
        files = {str(name): (int(entry["bytes"]), str(entry["sha256"])) for name, entry in data["files"].items()}
        bundle = Bundle(
            str(data["version"]),
            str(data["commit"])[:60],
            int(data["commit_utc_s"]),
            files,
            hashlib.sha256(content).hexdigest(),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UpdateError(f"the list of the bundle cannot be read: {error}") from None
    version_key(bundle.version)
    for name, (count, digest) in files.items():
        if not _FILE_NAME.fullmatch(name) or not 0 <= count <= _MAX_FILE_BYTES or not _HASH.fullmatch(digest):
            raise UpdateError(f"the list of the bundle has an invalid entry: {name[:60]!r}")
    return bundle


def version_key(version: str) -> tuple[int, ...]:
    """Return a sort key of a version, with 0.2.0.dev1 < 0.2.0rc1 < 0.2.0; raise UpdateError for an invalid version."""
    match = _VERSION.fullmatch(version)
    if match is None:
        raise UpdateError(f"{version[:40]!r} is not a version")
    return (*map(int, match.group(1, 2, 3)), _STAGES.index(match[4] or ""), int(match[5] or 0))


def is_older(bundle: Bundle, version: str, commit_utc_s: int | None) -> bool:
    """Return whether a bundle has an older version, or the same version and an older commit."""
    new, installed = version_key(bundle.version), version_key(version)
    return new < installed or (new == installed and commit_utc_s is not None and bundle.commit_utc_s < commit_utc_s)


def unpack(path: Path, folder: Path, signers: Path | None) -> Bundle:
    """Unpack a bundle into a new folder and return its list; raise UpdateError if it is invalid.

    With `signers` (an allowed-signers file of ssh-keygen), the bundle must be signed by one of them. List and signature
    are checked before other members are written.
    """
    try:
        source = os.fdopen(open_regular(path), "rb")
    except OSError as error:
        raise UpdateError(f"{path}: {error.strerror}; give a bundle made by make bundle") from None
    try:
        with source, tarfile.open(fileobj=source, mode="r:") as archive:
            member = archive.next()
            if member is None or member.name != LIST:
                raise UpdateError("it is not a bundle; make one (make bundle)")
            content = _read_member(archive, member, _MAX_LIST_BYTES)
            bundle = read_list(content)
            member = archive.next()
            signature = None
            if member is not None and member.name == SIGNATURE:
                signature = _read_member(archive, member, _MAX_SIGNATURE_BYTES)
                member = archive.next()
            folder.mkdir(mode=0o700)
            if signers is not None:
                _check_signature(content, signature, signers, folder)
            missing = set(bundle.files)
            while member is not None:
                if member.name not in missing:
                    raise UpdateError(
                        f"the bundle contains {member.name[:60]!r}, which is not in its list; copy it again"
                    )
                _write_member(archive, member, bundle, folder)
                missing.remove(member.name)
                member = archive.next()
    except (tarfile.TarError, EOFError) as error:
        raise UpdateError(f"it is incomplete or not a bundle ({error}); copy it again") from None
    if missing:
        raise UpdateError(f"{min(missing)} is missing, the bundle is incomplete; copy it again")
    (folder / LIST).write_bytes(content)
    return bundle


def _read_member(archive: tarfile.TarFile, member: tarfile.TarInfo, max_bytes: int) -> bytes:
    file = archive.extractfile(member) if member.isreg() and member.size <= max_bytes else None
    if file is None:
        raise UpdateError(f"{member.name[:60]} is not valid in a bundle; make one (make bundle)")
    return file.read()


def _write_member(archive: tarfile.TarFile, member: tarfile.TarInfo, bundle: Bundle, folder: Path) -> None:
    """Write a member to a file; raise UpdateError if its length or hash differs from the list."""
    count, digest = bundle.files[member.name]
    source = archive.extractfile(member) if member.isreg() and member.size == count else None
    if source is None:
        raise UpdateError(f"{member.name} has {member.size} bytes, {count} in the list; copy it again")
    hasher, remaining = hashlib.sha256(), count
    with (folder / member.name).open("xb") as target:
        while remaining and (chunk := source.read(min(remaining, _CHUNK_BYTES))):
            hasher.update(chunk)
            target.write(chunk)
            remaining -= len(chunk)
    if remaining or hasher.hexdigest() != digest:
        raise UpdateError(f"{member.name} is {'incomplete' if remaining else 'damaged (hash)'}; copy it again")


def _check_signature(content: bytes, signature: bytes | None, signers: Path, folder: Path) -> None:
    """Raise UpdateError unless the bundle is signed by one of the signers."""
    if signature is None:
        raise UpdateError(f"the bundle is not signed, but {signers} exists; sign it (make bundle SIGN=KEY)")
    program = shutil.which("ssh-keygen")
    if program is None:
        raise UpdateError("ssh-keygen is missing, which checks signatures; apt-get install openssh-client")
    file = folder / SIGNATURE
    file.write_bytes(signature)
    command = [program, "-Y", "verify", "-f", str(signers), "-I", SIGNER, "-n", NAMESPACE, "-s", str(file)]
    try:
        process = subprocess.run(command, input=content, capture_output=True, timeout=_TIMEOUT_S, check=False)  # noqa: S603 - fixed arguments
    except (OSError, subprocess.SubprocessError) as error:
        raise UpdateError(f"the signature cannot be checked: {error}") from None
    if process.returncode != 0:
        output = " ".join((process.stderr or process.stdout).decode("utf-8", "replace").split())[:160]
        raise UpdateError(f"the bundle is not signed by one of {signers}: {output}")
