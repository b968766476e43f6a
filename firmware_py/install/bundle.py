"""A bundle: one file with all that a version of the autopilot is installed from, without a network.

A tar archive. Its first member lists the others with their lengths and SHA-256; the next one may be a signature of that
list by ssh-keygen(1). `make bundle` makes it (.ci/bundle.py). Whatever is in it counts only once its hash is right.
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
SIGNER, NAMESPACE = "rambler", "rambler-update"  # the principal in the file of signers; what the signature is for
_MOST_LIST_BYTES, _MOST_SIGNATURE_BYTES, _MOST_FILE_BYTES = 1 << 20, 1 << 16, 1 << 30
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,200}")
_HASH = re.compile(r"[0-9a-f]{64}")
_VERSION = re.compile(r"(\d{1,6})\.(\d{1,6})\.(\d{1,6})(?:\.?(dev|a|b|rc)(\d{1,6}))?")
_STAGES = ("dev", "a", "b", "rc", "")
PYTHON: Final = sys.version_info[:2]
_CHUNK_BYTES = 1 << 20
_PATIENCE_S = 30.0


class UpdateError(RuntimeError):
    """An update cannot be made, or not of this bundle; the text names the remedy. What is in force stays."""


class Bundle(msgspec.Struct, frozen=True):
    """What the list of a bundle says: version, commit with its time, and each file with its length and hash.

    `digest` is the SHA-256 of the list, and so stands for all of it.
    """

    version: str
    commit: str
    commit_utc_s: int
    files: Mapping[str, tuple[int, str]]
    digest: str

    @property
    def title(self) -> str:
        """Return what it is called where people read it."""
        return title_text(self.version, self.commit)

    def of(self, prefix: str) -> str:
        """Return the name of the one wheel of a package; UpdateError when there is none."""
        for name in self.files:
            if name.startswith(f"{prefix}-") and name.endswith(".whl"):
                return name
        raise UpdateError(f"there is no wheel of {prefix} in it; make it anew (make bundle)")


def title_text(version: str, commit: str) -> str:
    """Return what a version is called where people read it."""
    return f"{version} (git {commit})" if commit else version


def check_computer(bundle: Bundle, machine: str = platform.machine(), python: tuple[int, int] = PYTHON) -> None:
    """Raise UpdateError when a package of a bundle is there for other computers or Pythons alone.

    A Python of 32 bits may run on a kernel of 64, which names the machine: that is left to pip.
    """
    if sys.maxsize < 1 << 32:
        return
    fits: dict[str, bool] = {}
    for name in bundle.files:
        if name.endswith(".whl") and name.count("-") >= 4:  # PACKAGE-VERSION[-BUILD]-PYTHON-ABI-PLATFORM.whl
            package, (made_for, abi, platforms) = name.partition("-")[0], name[:-4].split("-")[-3:]
            pure = abi == "none" and "any" in platforms.split(".")
            right_python = f"cp{python[0]}{python[1]}" in made_for.split(".") or abi in ("abi3", "none")
            ours = pure or (right_python and any(one.endswith(f"_{machine}") for one in platforms.split(".")))
            fits[package] = fits.get(package, False) or ours
    if missing := sorted(package for package, ours in fits.items() if not ours):
        computer = f"{machine}:{python[0]}.{python[1]}"
        raise UpdateError(f"it is for other computers than this one ({missing[0]}); make bundle FOR={computer}")


def read_list(content: bytes) -> Bundle:
    """Read the list of a bundle; UpdateError for what is none."""
    try:
        data: Any = read_json(content)
        if data["format"] != FORMAT:
            raise UpdateError(f"it has format {str(data['format'])[:20]}, this program reads {FORMAT}")
        files = {str(name): (int(entry["bytes"]), str(entry["sha256"])) for name, entry in data["files"].items()}
        bundle = Bundle(
            str(data["version"]),
            str(data["commit"])[:60],
            int(data["commit_utc_s"]),
            files,
            hashlib.sha256(content).hexdigest(),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UpdateError(f"its list cannot be read: {error}") from None
    version_key(bundle.version)
    for name, (count, digest) in files.items():
        if not _NAME.fullmatch(name) or not 0 <= count <= _MOST_FILE_BYTES or not _HASH.fullmatch(digest):
            raise UpdateError(f"its list names what no bundle holds: {name[:60]!r}")
    return bundle


def version_key(version: str) -> tuple[int, ...]:
    """Return what versions are ordered by: 0.2.0.dev1 < 0.2.0rc1 < 0.2.0; UpdateError for what is no version."""
    match = _VERSION.fullmatch(version)
    if match is None:
        raise UpdateError(f"{version[:40]!r} is no version")
    return (*map(int, match.group(1, 2, 3)), _STAGES.index(match[4] or ""), int(match[5] or 0))


def is_older(bundle: Bundle, version: str, commit_utc_s: int | None) -> bool:
    """Whether a bundle is older than what is in force: by its version, and within one by the time of its commit."""
    theirs, ours = version_key(bundle.version), version_key(version)
    return theirs < ours or (theirs == ours and commit_utc_s is not None and bundle.commit_utc_s < commit_utc_s)


def unpack(path: Path, folder: Path, signers: Path | None) -> Bundle:
    """Unpack a bundle into a new folder and return its list; UpdateError when anything about it is wrong.

    With a file of `signers` (ssh-keygen's allowed signers) only a bundle counts that one of them has signed. The list
    and its signature are looked at before anything else is written.
    """
    try:
        source = os.fdopen(open_regular(path), "rb")
    except OSError as error:
        raise UpdateError(f"{path}: {error.strerror}; name the file that make bundle has made") from None
    try:
        with source, tarfile.open(fileobj=source, mode="r:") as archive:
            member = archive.next()
            if member is None or member.name != LIST:
                raise UpdateError("it is no bundle; make one (make bundle)")
            content = _content(archive, member, _MOST_LIST_BYTES)
            bundle = read_list(content)
            member = archive.next()
            signature = None
            if member is not None and member.name == SIGNATURE:
                signature = _content(archive, member, _MOST_SIGNATURE_BYTES)
                member = archive.next()
            folder.mkdir(mode=0o700)
            if signers is not None:
                _check_signature(content, signature, signers, folder)
            missing = set(bundle.files)
            while member is not None:
                if member.name not in missing:
                    raise UpdateError(f"it holds {member.name[:60]!r}, which its list does not name; copy it anew")
                _write(archive, member, bundle, folder)
                missing.remove(member.name)
                member = archive.next()
    except (tarfile.TarError, EOFError) as error:
        raise UpdateError(f"it is cut off, or no bundle ({error}); copy it anew") from None
    if missing:
        raise UpdateError(f"{min(missing)} is missing: it is cut off; copy it anew")
    (folder / LIST).write_bytes(content)
    return bundle


def _content(archive: tarfile.TarFile, member: tarfile.TarInfo, most_bytes: int) -> bytes:
    file = archive.extractfile(member) if member.isreg() and member.size <= most_bytes else None
    if file is None:
        raise UpdateError(f"{member.name[:60]} in it is no file of a bundle; make one (make bundle)")
    return file.read()


def _write(archive: tarfile.TarFile, member: tarfile.TarInfo, bundle: Bundle, folder: Path) -> None:
    """Write one file; UpdateError when its length or hash is not that of the list."""
    count, digest = bundle.files[member.name]
    source = archive.extractfile(member) if member.isreg() and member.size == count else None
    if source is None:
        raise UpdateError(f"{member.name} has {member.size} bytes, by its list {count}; copy it anew")
    found, left = hashlib.sha256(), count
    with (folder / member.name).open("xb") as target:
        while left and (chunk := source.read(min(left, _CHUNK_BYTES))):
            found.update(chunk)
            target.write(chunk)
            left -= len(chunk)
    if left or found.hexdigest() != digest:
        raise UpdateError(f"{member.name} is {'cut off' if left else 'not what its list says (hash)'}; copy it anew")


def _check_signature(content: bytes, signature: bytes | None, signers: Path, folder: Path) -> None:
    """Raise UpdateError unless one of the signers has signed."""
    if signature is None:
        raise UpdateError(f"it is not signed, and {signers} is there; sign it (make bundle SIGN=KEY)")
    program = shutil.which("ssh-keygen")
    if program is None:
        raise UpdateError("ssh-keygen is not on this computer, which checks signatures; apt-get install openssh-client")
    file = folder / SIGNATURE
    file.write_bytes(signature)
    words = [program, "-Y", "verify", "-f", str(signers), "-I", SIGNER, "-n", NAMESPACE, "-s", str(file)]
    try:
        done = subprocess.run(words, input=content, capture_output=True, timeout=_PATIENCE_S, check=False)  # noqa: S603 - words of our own
    except (OSError, subprocess.SubprocessError) as error:
        raise UpdateError(f"its signature cannot be checked: {error}") from None
    if done.returncode != 0:
        said = " ".join((done.stderr or done.stdout).decode("utf-8", "replace").split())[:160]
        raise UpdateError(f"it is not signed by one of {signers}: {said}")
