#!/usr/bin/env python3
"""Makes a bundle that `rambler update` installs without a network: build/rambler-VERSION-COMMIT-MACHINE-PYTHON.bundle.

    bundle.py [--for MACHINE:PYTHON ...] [--sign KEY] [--out DIR]      as in: --for aarch64:3.13 aarch64:3.11

In it are the packages of the lock (.ci/requirements-onboard.txt) as wheels for these computers (default: this one), the
autopilot's own wheel, pip, and a list with the SHA-256 of each, signed by ssh-keygen with a key where one is given.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import platform
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from firmware_py import __version__, commit_of  # noqa: E402 - of this checkout
from firmware_py.install.bundle import FORMAT, LIST, LOCK, NAMESPACE, SIGNATURE  # noqa: E402

LOCK_FILE = ROOT / ".ci/requirements-onboard.txt"
# What installs them on the float; it does not stay there.
PIP = "pip==25.3 --hash=sha256:9655943313a94722b7774661c21049070f6bbb0a1516bf02f7c8d5d9201514cd\n"
GLIBC = ("2_28", "2_27", "2_26", "2_24", "2_17")  # the newest that a float may be asked for, and what runs on it, too
OWN = "rambler-autopilot"
# The computers for which the locked packages exist as wheels.
MACHINES, PYTHONS = ("aarch64", "x86_64"), ("3.11", "3.12", "3.13", "3.14")


def main() -> int:
    """Make it and print its path."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    here = f"{platform.machine()}:{sys.version_info.major}.{sys.version_info.minor}"
    parser.add_argument("--for", dest="computers", metavar="MACHINE:PYTHON", nargs="*", default=[])
    parser.add_argument("--sign", metavar="KEY", type=Path)
    parser.add_argument("--out", metavar="DIR", type=Path, default=ROOT / "build")
    arguments = parser.parse_args()
    computers = sorted(set(arguments.computers or [here]))
    for computer in computers:
        machine, _, python = computer.partition(":")
        if machine not in MACHINES or python not in PYTHONS:
            targets = f"MACHINE:PYTHON of {', '.join(MACHINES)} and {', '.join(PYTHONS)}, such as aarch64:3.13"
            return refused(f"{computer} is not supported; use {targets}")
    try:
        make(computers, arguments.out, arguments.sign)
    except subprocess.CalledProcessError as error:
        return refused(f"{error.cmd[0]} {' '.join(error.cmd[1:5])} ... failed; its messages are above")
    return 0


def refused(reason: str) -> int:
    """Print why there is no bundle, and return the exit code."""
    print(f"bundle: {reason}", file=sys.stderr)
    return 2


def make(computers: Sequence[str], out: Path, key: Path | None) -> None:
    """Make a bundle for computers and print its path; CalledProcessError from a program that fails."""
    with tempfile.TemporaryDirectory() as name:
        wheels = Path(name)
        for computer in computers:
            download(wheels, computer)
        requirements = wheels / "pip.txt"
        requirements.write_text(PIP)
        pip("download", "--no-deps", "--only-binary", ":all:", "--require-hashes", "-r", requirements, "-d", wheels)
        requirements.unlink()
        pip("wheel", "--no-deps", "--wheel-dir", wheels, ROOT)
        own = next(wheels.glob("rambler_autopilot-*.whl"))
        text = f"{LOCK_FILE.read_text()}{OWN}=={__version__} --hash=sha256:{digest(own.read_bytes())}\n"
        (wheels / LOCK).write_text(text)
        commit = commit_of(ROOT)
        out.mkdir(exist_ok=True)
        target = out / f"rambler-{__version__}-{commit}-{'_'.join(computers).replace(':', '-')}.bundle"
        pack(wheels, target, __version__, commit, commit_utc_s(), key)
    print(f"{target} ({target.stat().st_size / 1e6:.0f} MB)")


def download(wheels: Path, computer: str) -> None:
    """Take the locked packages for one computer."""
    machine, _, python = computer.partition(":")
    platforms = [word for glibc in GLIBC for word in ("--platform", f"manylinux_{glibc}_{machine}")]
    more = ["--platform", f"manylinux2014_{machine}", "--python-version", python, "-d", wheels]
    pip("download", "--no-deps", "--only-binary", ":all:", "--require-hashes", "-r", LOCK_FILE, *platforms, *more)


def pip(*words: object) -> None:
    """Run pip of this Python."""
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *map(str, words)]
    subprocess.run(command, check=True)  # noqa: S603 - words of our own


def commit_utc_s() -> int:
    """Return when the commit was made."""
    git = shutil.which("git") or "git"
    command = [git, "-C", str(ROOT), "show", "--no-patch", "--format=%ct", "HEAD"]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)  # noqa: S603 - words of our own


def digest(content: bytes) -> str:
    """Return a SHA-256."""
    return hashlib.sha256(content).hexdigest()


def pack(folder: Path, target: Path, version: str, commit: str, utc_s: int, key: Path | None = None) -> None:
    """Write the files of a folder as a bundle: the list first, then its signature; the same bytes each time."""
    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    listed = {name: {"bytes": len(content), "sha256": digest(content)} for name, content in files.items()}
    data = {"format": FORMAT, "version": version, "commit": commit, "commit_utc_s": utc_s, "files": listed}
    content = json.dumps(data, indent=1).encode() + b"\n"
    members = {LIST: content}
    if key is not None:
        command = [shutil.which("ssh-keygen") or "ssh-keygen", "-Y", "sign", "-f", str(key), "-n", NAMESPACE]
        signed = subprocess.run(command, input=content, check=True, capture_output=True)  # noqa: S603 - words of our own
        members[SIGNATURE] = signed.stdout
    with tarfile.open(target, "w:", format=tarfile.PAX_FORMAT) as archive:
        for name, body in (members | files).items():
            member = tarfile.TarInfo(name)
            member.size, member.mtime, member.mode = len(body), utc_s, 0o644
            archive.addfile(member, io.BytesIO(body))


if __name__ == "__main__":
    sys.exit(main())
